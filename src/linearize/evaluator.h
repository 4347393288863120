#pragma once

#include <cstdint>
#include <vector>

#include "base/executor.h"
#include "inceres/problem/factor_graph.h"
#include "linearize/layout.h"
#include "linearize/linearization.h"
#include "linearize/robustify.h"
#include "linearize/tangent.h"

namespace inceres::internal {

/// Owns the two points of a trust-region iteration, current and candidate, and evaluates the
/// factors at them.
///
/// Order of evaluation, calls to PlusJacobian and the correction for losses follow Ceres 2.1
/// (docs/ceres_contract.md, "Evaluation"): project to the tangent space first, then correct
/// residuals and Jacobians (Triggs 1999) so that the rest sees plain least squares. Pinned
/// variables (FactorGraph::PinLinearization) are linearized where they are pinned; free places of
/// an edited graph are passed over. Sums are taken over fixed groups of factors, so the cost is the
/// same to the last bit for any number of threads.
class Evaluator {
 public:
  Evaluator(const FactorGraph& graph, const Layout& layout, const Executor& executor,
            JacobianStorage storage = JacobianStorage::kBySlot);

  /// From now on for this graph, at its values; its structure (solver/structure.h) is that of the
  /// one before. Nothing computed for that one is used again.
  void Rebind(const FactorGraph& graph);

  const std::vector<double>& current() const { return current_; }
  const std::vector<double>& candidate() const { return candidate_; }
  std::vector<Linearization>& families() { return families_; }
  const std::vector<Linearization>& families() const { return families_; }
  const FactorGraph& graph() const { return *graph_; }
  const Layout& layout() const { return layout_; }
  const Executor& executor() const { return executor_; }
  JacobianStorage storage() const { return storage_; }

  /// Whether any variable that moves has bounds.
  bool IsConstrained() const { return !bounds_.empty(); }

  /// candidate := current ⊞ delta (packed), clamped to the bounds. False if a manifold's Plus
  /// fails; blocks before it are then already overwritten.
  bool MoveCandidate(const double* delta);

  /// The candidate itself, for who moves variables without a manifold one by one.
  std::vector<double>& mutable_candidate() { return candidate_; }

  /// Points the families' parameters to the candidate, for who evaluates factors there by himself.
  /// Not of whole rows.
  void PointToCandidate();

  /// ½ Σ ρ at the candidate, residuals only.
  Status EvaluateCandidateCost(double* cost);

  /// current := candidate, with its tangent maps.
  void AcceptCandidate();

  /// Lets the families move their factors' expansion points to the current values
  /// (FactorFamily::Recenter). Returns the number of factors that are another function now: costs
  /// and Jacobians computed before are then of no use.
  int Recenter();

  /// current := these values, a state as the graph lays it out.
  void SetCurrent(const std::vector<double>& state);

  /// Residuals, Jacobians and cost at the current point. `known_point`: its tangent maps were
  /// computed by EvaluateCandidateCost.
  Status EvaluateJacobians(bool known_point, double* cost);

  /// Which second-order terms of losses Jacobians take from now on. At first kPositive.
  void set_loss_curvature(LossCurvature curvature) { loss_curvature_ = curvature; }

  /// Whether blocks of Jacobians that are all zeros count as not there, with a tangent offset of
  /// -1, until the next Jacobians. Not of whole rows. At first they do not.
  void set_leaves_out_zero_blocks(bool leaves_out) { leaves_out_zero_blocks_ = leaves_out; }
  bool leaves_out_zero_blocks() const { return leaves_out_zero_blocks_; }

  std::int64_t Bytes() const;

 private:
  struct Chunk {
    int family;
    int begin;
    int end;
    int first_sum;  // in sums_
    // where the parameters of its factors point; to where it is evaluated, once it is
    bool at_candidate = false;
  };

  void BuildFamily(FamilyId id);
  void PlaceWholeRows(Linearization* cache) const;
  void BuildChunks(FamilyId id);
  void BindFamily(FamilyId id);
  void FindAllParameters(FamilyId id);
  void FindParameters(const std::vector<double>& state, FamilyId id,
                      std::vector<const double*>* parameters) const;
  void BuildTangents();
  void BuildBounds();
  template <typename Compute>
  Status ComputeTangents(const std::vector<double>& state, const Compute& compute);
  void PointTo(bool candidate, Chunk* chunk);
  EvaluationFailure EvaluateChunk(bool jacobians, Chunk* chunk);
  void PlaceInTangent(Linearization* cache, std::ptrdiff_t begin, std::ptrdiff_t end) const;
  static void LeaveOutZeroBlocks(const Chunk& chunk, Linearization* cache);
  double SumCosts(bool jacobians, Linearization* cache, int begin, int end);
  Status EvaluateAll(bool jacobians, double* cost);
  Status Prepare(bool jacobians, FamilyId id);
  Status DescribeFailure(bool jacobians, FamilyId id, const EvaluationFailure& failure) const;

  const FactorGraph* graph_;
  const Layout& layout_;
  const Executor& executor_;
  const JacobianStorage storage_;
  LossCurvature loss_curvature_ = LossCurvature::kPositive;
  bool leaves_out_zero_blocks_ = false;
  std::vector<double> current_;
  std::vector<double> candidate_;
  std::vector<Linearization> families_;
  std::vector<Chunk> chunks_;
  // of the costs of up to kSumSize factors each: what is added to what depends on nothing else
  std::vector<double> sums_;
  std::vector<EvaluationFailure> chunk_failures_;
  std::vector<std::int32_t> announced_;  // scratch of Prepare

  std::vector<const VariableBounds*>
      bounds_;                     // per entry of layout_.variables, null if free; empty if all are
  std::vector<Tangent> tangents_;  // per VariableId
  std::vector<VariableId> curved_;  // those of layout_.variables with a manifold, in this order
};

}  // namespace inceres::internal
