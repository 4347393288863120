#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <vector>

#include "base/executor.h"
#include "base/lowest_index.h"
#include "base/zeroed_array.h"
#include "inceres/problem/factor_graph.h"
#include "linearize/robustify.h"
#include "problem/kept_evaluations.h"
#include "simd/kernels.h"

namespace inceres::internal {

class VariableLookUp;

/// How the tangent Jacobians of a family's factors lie in memory.
enum class JacobianStorage {
  kBySlot,  ///< those of each slot together, rows padded: factors touch what they like
  /// rows of J with all columns: a small problem whose factors touch the same variables
  kWholeRows,
  /// those of each factor together, rows without padding: for passes over J that take as long as
  /// memory needs to give it
  kByFactor,
  /// as kByFactor, and those of families that are large (Linearization::MayKeepSingles) in single
  /// precision
  kByFactorInSingle,
  /// as kByFactor, in the order of the factors, whatever landmarks they touch: where padding would
  /// take much memory
  kWithoutPadding,
  /// as kWithoutPadding, landmark by landmark, and only those of some landmarks at a time:
  /// evaluated anew for each pass (JacobianChunks)
  kInChunks,
};

/// Where linearizing writes: what belongs to factor i is i strides behind these.
struct LinearizationPlaces {
  const SlotJacobians* slots;
  const JacobianView* views;  ///< the same, as the public interface calls them
  double* residuals;
};

/// Of a family whose zero blocks are left out (LeaveOutZeroBlocks), else empty. Per entry:
struct ZeroBlocks {
  UnwrittenVector<std::int32_t> all_offsets;  ///< tangent offsets with those of zero blocks
  std::unique_ptr<bool[]> are_zero;           ///< what the family says of the blocks
};

/// The factors of one family, linearized: where their variables are, residuals and tangent
/// Jacobians, by the places of the factors, free ones among them. Everyone who evaluates factors
/// does it through one of these, all of a range or those of a list; columns that he does not need
/// are empty. A factor's *entries* are its slots: entry = factor · num_slots + slot.
///
/// Pinned variables (FactorGraph::PinLinearization) are linearized where they are pinned; residuals
/// are those where they are.
struct Linearization {
  Linearization(const FactorGraph& graph, FamilyId id);

  /// Room for so many factors in the columns of entries and in the residuals.
  void GrowTables(int num_places);
  /// The same for who writes parameters and tangent maps of all places next.
  void MakeTables(int num_places);
  /// And in those of the candidate and the Jacobians. `capacity` of them fit in before they lie
  /// elsewhere.
  void Grow(int num_places, int capacity);

  /// Whether a family with so many places may be linearized strip by strip: one so large that a
  /// strip does not take what is saved.
  static bool MayHaveStrips(int num_places) { return num_places > 2 * kStripSize; }
  /// Whether it is kept in single precision where that is asked for. Not those that are told
  /// beforehand what they will be asked (FactorFamily::Prepares), for they may write all Jacobians
  /// at once.
  static bool MayKeepSingles(const FactorFamily& family, int num_places) {
    return MayHaveStrips(num_places) && !family.Prepares();
  }
  /// Factors of a strip, at most.
  static constexpr int kStripSize = 2048;

  /// Instead of Grow, once: room for the Jacobians of so many factors, those of each together, in
  /// single precision or in double, and in this order (`records`). Where either is not how factors
  /// are written, a strip of them has room as they are written.
  void PlaceByFactor(int num_places, bool in_singles, std::vector<std::int32_t> order);
  bool has_strips() const { return strip_values.size() > 0; }
  bool keeps_singles() const { return !slots.empty() && slots[0].single != nullptr; }
  /// Until EndStrip residuals and Jacobians of up to kStripSize factors from `first` on are
  /// written, and found by their factors, in the strip.
  void BeginStrip(int first);
  void EndStrip();
  /// Factors are written, and read, where their records from this one on lie at `first`.
  void PlaceSlots(int record, double* first);
  /// Copies those of [begin, end), which are of the strip, to their records. Several threads may do
  /// so, each with factors of its own.
  void KeepStrip(int begin, int end);

  /// Where the entry's variable is and where a pin linearizes it, or null; and its tangent map.
  void Connect(std::size_t entry, const double* x, const double* pinned, const TangentMap& map);
  void Pin(std::size_t entry, const double* pinned);

  /// Residuals of the candidate, of these factors; the batch lacks what a user of his own adds to
  /// it, Jacobians say.
  FactorBatch CandidateBatch(int begin, int end);
  EvaluationFailure EvaluateCandidate(int begin, int end) {
    return EvaluateCandidate(begin, end, candidate_residuals.data());
  }
  /// The residual of factor i goes to f + i · residual_size.
  EvaluationFailure EvaluateCandidate(int begin, int end, double* f);
  /// Residuals and Jacobians.
  EvaluationFailure Linearize(int begin, int end) { return Linearize(begin, end, places()); }
  EvaluationFailure Linearize(int begin, int end, const LinearizationPlaces& places);
  /// As these factors are written without anything else being said.
  LinearizationPlaces places() const { return {slots.data(), views.data(), WrittenResiduals()}; }
  /// Tells a family that wants to know it (FactorFamily::Prepares) which factors the calls of
  /// EvaluateCandidate, or of Linearize, that follow ask for: an ascending list.
  EvaluationFailure Prepare(bool jacobians, const std::vector<std::int32_t>& factors);

  /// Evaluator::MakeRoomToKeep and KeepEvaluations below, of this family.
  std::int64_t BytesToKeep() const;
  std::int64_t BytesKept() const { return kept_ != nullptr ? BytesToKeep() : 0; }
  void MakeRoomToKeep();
  void KeepEvaluations(bool keep);

  /// evaluate(begin, end) for each run of neighbors in an ascending list, one after the other or in
  /// tasks. The first failure.
  template <typename Evaluate>
  EvaluationFailure ForRuns(const std::vector<std::int32_t>& factors, const Executor& executor,
                            const Evaluate& evaluate);

  const double* const* Parameters(int factor) const { return parameters.data() + Entry(factor); }
  /// Where Linearize has evaluated the factor last: if it failed, there. Its pins, if the call with
  /// Jacobians did, else Parameters.
  const double* const* LinearizedParameters(int factor) const {
    return (pins.empty() ? parameters.data() : jacobian_parameters_.data()) + Entry(factor);
  }
  const double* const* CandidateParameters(int factor) const {
    return (candidate_parameters.empty() ? parameters : candidate_parameters).data() +
           Entry(factor);
  }
  std::ptrdiff_t Entry(int factor) const { return std::ptrdiff_t{factor} * num_slots; }
  /// Where passes over J find the factor: its index into RecordOffsets and, outside of strips, into
  /// residuals and Jacobians.
  int Record(int factor) const { return records.empty() ? factor : records[factor]; }
  const std::int32_t* RecordOffsets() const {
    return (records.empty() ? tangent_offsets : record_offsets).data();
  }
  /// The residual of factor 0 as linearizing writes it; those of the others follow.
  double* WrittenResiduals() const;
  bool has_whole_rows() const { return storage == JacobianStorage::kWholeRows; }
  /// What products with J take for one factor: all of a family's whole rows are one.
  int num_blocks() const { return has_whole_rows() ? std::min(num_factors, 1) : num_factors; }
  int rows_per_block() const { return residual_size * (has_whole_rows() ? num_factors : 1); }
  FactorRows Rows(int begin, int end) const;

  const FactorGraph* graph;
  const FactorFamily* family;
  FamilyId id;
  int residual_size;
  int num_slots;
  int num_factors = 0;  // places
  int capacity = 0;
  JacobianStorage storage = JacobianStorage::kBySlot;
  ZeroedArray residuals;
  ZeroedArray candidate_residuals;
  // by slot, or records, or whole rows; records may be floats, two in the place of a double
  ZeroedArray jacobian_values;
  ZeroedArray strip_values;          // Jacobians, then residuals; mostly empty
  std::vector<SlotJacobians> slots;  // of whole rows there is one
  std::vector<JacobianView> views;   // the same places, as the public interface calls them
  // what entries of it need is looked up there; null: in the next columns
  const VariableLookUp* look_up = nullptr;
  // Per entry:
  // without the second column: at the point where it was evaluated last
  UnwrittenVector<const double*> parameters;
  UnwrittenVector<const double*> candidate_parameters;  // or empty
  // where it is linearized, null if where it is; empty without any
  std::vector<const double*> pins;
  UnwrittenVector<const TangentMap*> tangent_maps;
  // Quads into the padded tangent vector, or -1 where the Jacobian has no block; of whole rows: one
  // 0.
  UnwrittenVector<std::int32_t> tangent_offsets;
  ZeroBlocks zero_blocks;
  // Per factor: Record; empty where each is its own. And tangent_offsets in that order.
  std::vector<std::int32_t> records;
  UnwrittenVector<std::int32_t> record_offsets;
  // per factor: its loss at the candidate that was evaluated last; empty where nobody keeps it
  std::vector<LossValue> loss_values;

 private:
  bool IsPinned(int factor) const;
  FactorBatch LinearizationBatch(int begin, int end);
  EvaluationFailure LinearizePinned(FactorBatch batch);

  int strip_begin_ = 0;
  bool prepared_ = false;  // what is evaluated next
  bool keeps_ = false;
  std::unique_ptr<KeptEvaluations> kept_;  // null: no room
  // of the size of pins: where the factor of the entry is evaluated at present, or was last
  std::vector<const double*> jacobian_parameters_;
  std::vector<EvaluationFailure> failures_;  // per task of ForRuns
};

/// Strides of blocks that follow each other factor by factor, rows without padding; returns that
/// from factor to factor.
std::ptrdiff_t PackRows(Linearization* factors);

/// J_rᵀJ_c of two slots, with the rows of r and the columns of c, and Jᵀf of one: terms, their
/// number and the sizes of the block are the caller's.
BlockProducts ProductsOf(const Linearization& factors, int row_slot, int column_slot);
VectorProducts GradientOf(const Linearization& factors, int slot);

/// Entries of J of one factor that a pass over J reads.
std::ptrdiff_t FactorSize(const Linearization& factors);

/// Each factor's last evaluation with Jacobians is kept, for whoever comes back to its values,
/// until this is taken back. Nothing is without room.
void KeepEvaluations(bool keep, std::vector<Linearization>* families);

/// failures[k] := evaluate(k) for all k, in tasks. What lies behind one that failed is left out, as
/// Ceres calls nothing more after a failure: returns the first that failed, or -1.
template <typename Evaluate>
int EvaluateTasks(const Executor& executor, std::vector<EvaluationFailure>* failures,
                  const Evaluate& evaluate) {
  const int count = static_cast<int>(failures->size());
  if (count == 1) {  // of a small problem: no tasks, which would take as long as some factors
    failures->front() = evaluate(0);
    return failures->front().failed() ? 0 : -1;
  }
  LowestIndex first_failed(count);
  executor.For(count, 1, [&](int begin, int end) {
    for (int k = begin; k < end; ++k) {
      EvaluationFailure& failure = (*failures)[static_cast<std::size_t>(k)];
      failure = EvaluationFailure();
      if (k < first_failed.get()) {
        failure = evaluate(k);
      }
      if (failure.failed()) {
        first_failed.Note(k);
      }
    }
  });
  return first_failed.get() < count ? first_failed.get() : -1;
}

template <typename Evaluate>
EvaluationFailure Linearization::ForRuns(const std::vector<std::int32_t>& factors,
                                         const Executor& executor, const Evaluate& evaluate) {
  // factors a task, at most; a smaller list stays on the calling thread
  constexpr int kGrain = 512;
  const auto run = [&](int begin, int end) -> EvaluationFailure {
    for (int k = begin; k < end;) {
      int next = k + 1;
      while (next < end && factors[next] == factors[next - 1] + 1) {
        ++next;
      }
      const EvaluationFailure failure = evaluate(factors[k], factors[next - 1] + 1);
      if (failure.failed()) {
        return failure;
      }
      k = next;
    }
    return {};
  };
  const int count = static_cast<int>(factors.size());
  const int grain = std::clamp(family->TaskSize(), 1, kGrain);
  if (executor.num_threads() == 1 || count <= grain) {
    return run(0, count);
  }
  failures_.resize((count + grain - 1) / grain);
  const int first = EvaluateTasks(executor, &failures_, [&](int task) {
    return run(task * grain, std::min(count, (task + 1) * grain));
  });
  return first < 0 ? EvaluationFailure() : failures_[first];
}

}  // namespace inceres::internal
