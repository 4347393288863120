#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "base/aligned_vector.h"
#include "base/executor.h"
#include "base/zeroed_array.h"
#include "inceres/problem/factor_graph.h"
#include "linearize/layout.h"
#include "simd/kernels.h"

namespace inceres::internal {

/// How the tangent Jacobians of a family's factors lie in memory.
enum class JacobianStorage {
  kBySlot,     ///< those of each slot together: factors touch what they like
  kWholeRows,  ///< rows of J with all columns: a small problem whose factors touch the same variables
};

/// Whole rows where there are no landmarks, at most 16 unknowns and 1,024 residuals, and within each family all factors touch the
/// same variables, as in curve fitting and calibration: then J is one small dense matrix.
JacobianStorage StorageFor(const FactorGraph& graph, const Layout& layout);

/// Residuals and tangent Jacobians of one family at the current point, after the correction for the loss.
struct FamilyCache {
  const FactorFamily* family = nullptr;
  FamilyId id = 0;
  int num_factors = 0;
  bool has_losses = false;
  JacobianStorage storage = JacobianStorage::kBySlot;
  ZeroedArray residuals;
  ZeroedArray candidate_residuals;
  ZeroedArray jacobian_values;                      // all slots, one after the other, or whole rows
  std::vector<SlotJacobians> slots;                 // of whole rows there is one
  std::vector<JacobianView> views;                  // the same places slot by slot, as the public interface calls them
  std::vector<const double*> parameters;            // per factor and slot, at the point where their chunk was evaluated last
  std::vector<const double*> candidate_parameters;  // of whole rows only, whose others are at the current point throughout
  std::vector<const double*> pins;  // per factor and slot: where it is linearized, null if where it is; empty without any
  std::vector<const double*> jacobian_parameters;  // scratch of the same size
  std::vector<const TangentMap*> tangent_maps;     // per factor and slot
  // Per factor and slot: quads into the padded tangent vector, or -1 where the Jacobian has no block; of whole rows: 0.
  std::vector<std::int32_t> tangent_offsets;

  /// What products with J take for one factor: all of a family's whole rows are one.
  int num_blocks() const { return storage == JacobianStorage::kBySlot ? num_factors : std::min(num_factors, 1); }
  int rows_per_block() const { return family->residual_size() * (storage == JacobianStorage::kBySlot ? 1 : num_factors); }
  FactorRows Rows(int begin, int end) const;
};

/// Owns the two points of a trust-region iteration, current and candidate, and evaluates the factors at them.
///
/// Order of evaluation, calls to PlusJacobian and the correction for losses follow Ceres 2.1 (docs/ceres_contract.md,
/// "Evaluation"): project to the tangent space first, then correct residuals and Jacobians (Triggs 1999) so that the rest sees
/// plain least squares.
/// Pinned variables (FactorGraph::PinLinearization) are linearized where they are pinned; free places of an edited graph are
/// passed over. Sums are taken over fixed groups of factors, so the cost is the same to the last bit for any number of threads.
class Evaluator {
 public:
  Evaluator(const FactorGraph& graph, const Layout& layout, const Executor& executor,
            JacobianStorage storage = JacobianStorage::kBySlot);

  /// From now on for this graph, at its values; its structure (solver/structure.h) is that of the one before. Nothing computed
  /// for that one is used again.
  void Rebind(const FactorGraph& graph);

  const std::vector<double>& current() const { return current_; }
  const std::vector<double>& candidate() const { return candidate_; }
  std::vector<FamilyCache>& families() { return families_; }
  const std::vector<FamilyCache>& families() const { return families_; }
  const FactorGraph& graph() const { return *graph_; }
  const Layout& layout() const { return layout_; }
  const Executor& executor() const { return executor_; }
  JacobianStorage storage() const { return storage_; }

  /// Whether any variable that moves has bounds.
  bool IsConstrained() const { return !bounds_.empty(); }

  /// candidate := current ⊞ delta (packed), clamped to the bounds. False if a manifold's Plus fails; blocks before it are then
  /// already overwritten.
  bool MoveCandidate(const double* delta);

  /// The candidate itself, for who moves variables without a manifold one by one.
  std::vector<double>& mutable_candidate() { return candidate_; }

  /// Points the families' parameters to the candidate, for who evaluates factors there by himself. Not of whole rows.
  void PointToCandidate();

  /// ½ Σ ρ at the candidate, residuals only.
  Status EvaluateCandidateCost(double* cost);

  /// current := candidate, with its tangent maps.
  void AcceptCandidate();

  /// Lets the families move their factors' expansion points to the current values (FactorFamily::Recenter). Returns the number
  /// of factors that are another function now: costs and Jacobians computed before are then of no use.
  int Recenter();

  /// current := these values, a state as the graph lays it out.
  void SetCurrent(const std::vector<double>& state);

  /// Residuals, Jacobians and cost at the current point. `known_point`: its tangent maps were computed by EvaluateCandidateCost.
  Status EvaluateJacobians(bool known_point, double* cost);

  /// Whether Jacobians have the second-order terms of losses with ρ'' < 0 from now on (RobustifyFactor). At first they have not.
  void set_reduces_curvature(bool reduces) { reduces_curvature_ = reduces; }

  /// Whether blocks of Jacobians that are all zeros count as not there, with a tangent offset of -1, until the next Jacobians.
  /// Not of whole rows. At first they do not.
  void set_leaves_out_zero_blocks(bool leaves_out) { leaves_out_zero_blocks_ = leaves_out; }
  bool leaves_out_zero_blocks() const { return leaves_out_zero_blocks_; }

  std::int64_t Bytes() const;

 private:
  struct Chunk {
    int family;
    int begin;
    int end;
    int first_sum;              // in sums_
    bool at_candidate = false;  // where the parameters of its factors point; to where it is evaluated, once it is
  };

  void BuildFamily(FamilyId id);
  void PlaceSlots(FamilyCache* cache) const;
  void PlaceWholeRows(FamilyCache* cache) const;
  void BuildChunks(FamilyId id);
  void BindFamily(FamilyId id);
  void FindAllParameters(FamilyId id);
  void FindParameters(const std::vector<double>& state, FamilyId id, std::vector<const double*>* parameters) const;
  void BuildMaps();
  void BuildBounds();
  Status ComputePlusJacobians(const std::vector<double>& state, std::vector<double>* values);
  void ClassifyMaps();
  void PointTo(bool candidate, Chunk* chunk);
  EvaluationFailure EvaluatePinned(const Chunk& chunk, FactorBatch batch);
  EvaluationFailure EvaluateChunk(bool jacobians, Chunk* chunk);
  void PlaceInTangent(FamilyCache* cache, std::ptrdiff_t begin, std::ptrdiff_t end) const;
  static void LeaveOutZeroBlocks(const Chunk& chunk, FamilyCache* cache);
  double SumCosts(bool jacobians, FamilyCache* cache, int begin, int end);
  Status EvaluateAll(bool jacobians, double* cost);

  const FactorGraph* graph_;
  const Layout& layout_;
  const Executor& executor_;
  const JacobianStorage storage_;
  bool reduces_curvature_ = false;
  bool leaves_out_zero_blocks_ = false;
  std::vector<double> current_;
  std::vector<double> candidate_;
  std::vector<FamilyCache> families_;
  std::vector<Chunk> chunks_;
  std::vector<double> sums_;  // of the costs of up to kSumSize factors each: what is added to what depends on nothing else
  std::vector<EvaluationFailure> chunk_failures_;

  std::vector<const VariableBounds*> bounds_;       // per entry of layout_.variables, null if free; empty if all are
  std::vector<TangentMap> maps_;                    // per VariableId
  std::vector<int> curved_;                         // indices into layout_.variables of those with a manifold
  std::vector<std::int64_t> plus_jacobian_offset_;  // per entry of curved_
  std::vector<std::int64_t> selection_offset_;
  std::vector<double> plus_jacobians_;
  std::vector<double> candidate_plus_jacobians_;
  std::vector<int> selections_;
};

}  // namespace inceres::internal
