#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "base/executor.h"
#include "base/memory_budget.h"
#include "inceres/problem/factor_graph.h"
#include "linearize/jacobian_chunks.h"
#include "linearize/layout.h"
#include "linearize/linearization.h"
#include "linearize/point_pair.h"
#include "linearize/robustify.h"

namespace inceres::internal {

/// Evaluates the factors at the two points of a trust-region iteration, current and candidate.
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

  /// From now on for this graph, at its values; its structure (trust_region/structure.h) is that of
  /// the one before. Nothing computed for that one is used again.
  void Rebind(const FactorGraph& graph);

  /// To be moved by whoever steps; but it is the evaluator that accepts, for its factors follow.
  PointPair& points() { return points_; }
  const PointPair& points() const { return points_; }
  std::vector<Linearization>& families() { return families_; }
  const std::vector<Linearization>& families() const { return families_; }
  const FactorGraph& graph() const { return *graph_; }
  const Layout& layout() const { return layout_; }
  const Executor& executor() const { return executor_; }
  JacobianStorage storage() const { return storage_; }

  /// Of Jacobians that are not kept; null where they are.
  JacobianChunks* jacobian_chunks() const { return jacobian_chunks_.get(); }

  /// Room for KeepEvaluations of the families, where it is not too much.
  void MakeRoomToKeep();

  /// ½ Σ ρ at the candidate, residuals only. `knows_tangents`: points() has computed them there.
  Status EvaluateCandidateCost(double* cost, bool knows_tangents = false);

  /// The candidate is the current point from now on.
  void AcceptCandidate() { points_.AcceptCandidate(); }

  /// Lets the families move their factors' expansion points to the current values
  /// (FactorFamily::Recenter). Returns the number of factors that are another function now: costs
  /// and Jacobians computed before are then of no use.
  int Recenter();

  /// Jᵀf of the families that keep Jacobians in single precision, padded, summed from those in
  /// double; null if there are none. Of the last EvaluateJacobians.
  const double* strip_gradient() const { return gradient_.empty() ? nullptr : gradient_.data(); }

  /// Residuals, Jacobians and cost at the current point. `known_point`: it was a candidate whose
  /// cost EvaluateCandidateCost has evaluated: tangent maps are known, and losses of factors whose
  /// residual is the same to the bit. `knows_tangents`: those of a new point are known, too.
  Status EvaluateJacobians(bool known_point, double* cost, bool knows_tangents = false);

  /// Which second-order terms of losses Jacobians take from now on. At first kPositive.
  void set_loss_curvature(LossCurvature curvature) { loss_curvature_ = curvature; }
  LossCurvature loss_curvature() const { return loss_curvature_; }

  /// Whether blocks of Jacobians that are all zeros count as not there, with a tangent offset of
  /// -1, until the next Jacobians. Not of whole rows. At first they do not.
  void set_leaves_out_zero_blocks(bool leaves_out);
  bool leaves_out_zero_blocks() const { return leaves_out_zero_blocks_; }

  /// What to say of a factor that failed, with the values at which it did.
  Status DescribeFailure(bool jacobians, FamilyId id, const EvaluationFailure& failure);
  /// At which factor the last pass that failed did so.
  FactorId failed_factor() const { return failed_factor_; }

  std::int64_t Bytes() const;

  /// Who plans with this evaluator counts here what he takes; null: nobody counts.
  void set_memory_budget(MemoryBudget* budget) { memory_budget_ = budget; }
  void Take(std::int64_t bytes, const char* what) const {
    if (memory_budget_ != nullptr) {
      memory_budget_->Take(bytes, what);
    }
  }
  void GiveBack(std::int64_t bytes) const {
    if (memory_budget_ != nullptr) {
      memory_budget_->GiveBack(bytes);
    }
  }
  /// Whether he may still take so many.
  bool HasRoomFor(std::int64_t bytes) const {
    return memory_budget_ == nullptr || memory_budget_->HasRoomFor(bytes);
  }

 private:
  struct Chunk {
    int family;
    int begin;
    int end;
    int first_sum;  // in sums_
  };

  // Chunks, one after the other, that are linearized at the same time.
  struct Strip {
    int family;  // that has strips, or -1
    int begin;   // of chunks_
    int end;
  };

  void BuildFamily(FamilyId id);
  void CutStrips();
  void BuildChunks(FamilyId id);
  void BindFamily(FamilyId id);
  void FindParameters(FamilyId id);
  EvaluationFailure EvaluateChunk(bool jacobians, bool known_point, const Chunk& chunk);
  Status EvaluateAll(bool jacobians, bool known_point, double* cost);
  Status EvaluateChunks(bool jacobians, bool known_point, int begin, int end);
  Status EvaluateStrips(bool known_point);
  Status Prepare(bool jacobians, FamilyId id);

  const FactorGraph* graph_;
  const Layout& layout_;
  const Executor& executor_;
  const JacobianStorage storage_;
  LossCurvature loss_curvature_ = LossCurvature::kPositive;
  bool leaves_out_zero_blocks_ = false;
  MemoryBudget* memory_budget_ = nullptr;
  PointPair points_;
  std::vector<Linearization> families_;
  std::vector<Chunk> chunks_;
  // of the costs of up to kSumSize factors each: what is added to what depends on nothing else
  std::vector<double> sums_;
  std::vector<EvaluationFailure> chunk_failures_;
  FactorId failed_factor_;
  std::vector<std::int32_t> announced_;  // scratch of Prepare
  std::vector<Strip> strips_;            // empty: no family has any
  AlignedVector<double> gradient_;       // padded; of families in single precision
  std::unique_ptr<JacobianChunks> jacobian_chunks_;
};

}  // namespace inceres::internal
