#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>
#include <vector>

#include "inceres/problem/constant_size.h"
#include "inceres/problem/factor_family.h"

namespace inceres {

namespace internal {

/// Copies the first columns of `count` ambient Jacobians (num_rows × their columns, one after the
/// other), the product with M = [I; 0], to blocks factor_stride apart with rows row_stride apart.
/// False, and nothing written, if the sum of the magnitudes of their entries does not prove that
/// they are ordinary.
using TakeFunction = bool (*)(int count, const double* J_ambient, int num_rows, double* J_tangent,
                              std::ptrdiff_t factor_stride, int row_stride);

/// The ambient Jacobians of one slot, of a few neighboring factors, and where their tangent ones
/// go.
struct AmbientSlot {
  double* values = nullptr;     ///< one after the other
  double* J_tangent = nullptr;  ///< of the first factor
  std::ptrdiff_t factor_stride = 0;
  int row_stride = 0;
  int num_rows = 0;
  int ambient_size = 0;
  int size = 0;  ///< of one Jacobian
  TakeFunction take = nullptr;
};

/// Of the sizes; null if there is none.
INCERES_EXPORT TakeFunction FindTake(int num_rows, int ambient_size, int columns);

/// Factors whose Jacobians are taken over at a time, at most.
constexpr int kMostTaken = 8;

/// Slots whose tables need no memory of their own.
constexpr std::size_t kInlineSlots = 16;

/// Where one factor after the other writes its Jacobians, slot by slot.
struct AmbientOutputs {
  double** blocks;          ///< of one factor, whose function may change the array
  double** next;            ///< those of the next one; null for a constant
  std::ptrdiff_t* strides;  ///< from factor to factor
};

/// Where the ambient Jacobians of a few factors are written. Up to kInline doubles live on the
/// stack: small factors allocate nothing.
struct AmbientScratch {
  static constexpr std::size_t kInline = 512;

  /// `most`: factors at a time.
  AmbientScratch(const FactorFamily& family, const FactorBatch& batch, int most) {
    const auto count = static_cast<std::size_t>(family.num_slots());
    if (count > kInlineSlots) {
      heap_blocks.resize(2 * count);
      heap_strides.resize(count);
      heap_slots.resize(count);
      outputs = {heap_blocks.data(), heap_blocks.data() + count, heap_strides.data()};
      slots = heap_slots.data();
    }
    for (int s = 0; s < family.num_slots(); ++s) {
      const FactorFamily::Slot& slot = family.slot(s);
      const JacobianView& view = batch.jacobians[s];
      slots[s] = {nullptr,
                  view.data + batch.begin * view.factor_stride,
                  view.factor_stride,
                  view.row_stride,
                  family.residual_size(),
                  slot.ambient_size,
                  family.residual_size() * slot.ambient_size,
                  FindTake(family.residual_size(), slot.ambient_size, slot.tangent_size)};
      size += slots[s].size;
    }
    group = std::min(most, batch.end - batch.begin);
    if (size > 0) {
      group = std::clamp(static_cast<int>(kInline) / size, 1, std::max(group, 1));
    }
    const auto room = static_cast<std::size_t>(size) * static_cast<std::size_t>(group);
    if (room > kInline) {
      heap.reset(new double[room]);  // not make_unique: it is filled at once
    }
    double* next = room > kInline ? heap.get() : stack;
    for (std::size_t s = 0; s < count; ++s) {
      slots[s].values = next;
      next += std::ptrdiff_t{group} * slots[s].size;
    }
  }
  AmbientScratch(const AmbientScratch&) = delete;
  AmbientScratch& operator=(const AmbientScratch&) = delete;

  double stack[kInline];
  double* stack_blocks[2 * kInlineSlots];
  std::ptrdiff_t stack_strides[kInlineSlots];
  AmbientSlot stack_slots[kInlineSlots];
  std::unique_ptr<double[]> heap;
  std::vector<double*> heap_blocks;
  std::vector<std::ptrdiff_t> heap_strides;
  std::vector<AmbientSlot> heap_slots;
  AmbientOutputs outputs = {stack_blocks, stack_blocks + kInlineSlots, stack_strides};
  AmbientSlot* slots = stack_slots;
  int size = 0;   ///< of one factor's
  int group = 1;  ///< factors at a time
};

/// Checks and projects the Jacobians of `count` factors, at most kMostTaken; maps[n · map_stride]
/// is that of factor n, and all are alike. Returns the first factor with an entry that is not
/// finite or was not written, or −1.
INCERES_EXPORT int TakeAlike(const AmbientSlot& slot, const TangentMap* const* maps, int map_stride,
                             int count);

/// The same of all slots of factor i, whose Jacobians are `size` entries one after the other and
/// their tangent ones i strides behind those that `slots` name. What is all zeros is only noted, by
/// slot. Returns the first slot with such an entry, or −1.
INCERES_EXPORT int TakeNonzero(const AmbientSlot* slots, const TangentMap* const* maps,
                               int num_slots, int size, std::ptrdiff_t i, bool* zero_blocks);

/// As MarkUnwritten, of many entries.
INCERES_EXPORT void MarkManyUnwritten(double* values, int count);

/// A family with more slots keeps nothing.
constexpr int kMostKeptSlots = 16;

/// Of batch.kept and factor i: true if it was evaluated at these parameters with all the Jacobians
/// that are wanted now; its residuals are then written. Otherwise `blocks`, of kMostKeptSlots, says
/// where its Jacobians go, marked as unwritten as its residuals are.
INCERES_EXPORT bool FetchKept(const FactorBatch& batch, int i, double** blocks);
/// Checks and projects the Jacobians that are wanted, and keeps the evaluation if it `is_new`, was
/// not fetched. Returns the first slot with an entry that is not finite or was not written, whose
/// Jacobian `J` is then, or −1.
INCERES_EXPORT int TakeKept(const FactorBatch& batch, int i, bool is_new, const double** J);

}  // namespace internal

/// Writes J_tangent (num_rows × map.tangent_size, rows row_stride apart) = J_ambient (row-major,
/// contiguous) · M. Does nothing where no Jacobian is wanted. Cost: a copy for identity and
/// selection maps.
INCERES_EXPORT void ProjectToTangentSpace(const TangentMap& map, const double* J_ambient,
                                          int num_rows, double* J_tangent, int row_stride);

/// What entries nobody has written yet hold.
constexpr double kUnwritten = 1e302;

/// Fills `values` with kUnwritten, so that AreWritten finds what was forgotten.
inline void MarkUnwritten(double* values, int count) {
  for (; count > 3; count -= 4, values += 4) {
    for (int k = 0; k < 4; ++k) {
      values[k] = kUnwritten;
    }
  }
  if (count > 0) {  // one to three, as most are to begin with: without a loop
    values[0] = kUnwritten;
    if (count > 1) {
      values[1] = kUnwritten;
      if (count > 2) {
        values[2] = kUnwritten;
      }
    }
  }
}

/// Whether a sum of magnitudes proves that each of them is finite and has been written. It need
/// not: a finite one may be larger.
inline bool AreOrdinary(double sum_of_magnitudes) {
  return sum_of_magnitudes < 0.01 * kUnwritten;
}

/// Whether every entry is finite and has been written since MarkUnwritten.
INCERES_EXPORT bool AreAllWritten(const double* values, int count);

/// The same; up to three ordinary entries, as most residuals are, need neither call nor loop.
inline bool AreWritten(const double* values, int count) {
  if (count > 0 && count <= 3) {
    double sum = std::fabs(values[0]);
    if (count > 1) {
      sum += std::fabs(values[1]);
      if (count > 2) {
        sum += std::fabs(values[2]);
      }
    }
    if (AreOrdinary(sum)) {
      return true;
    }
  }
  return AreAllWritten(values, count);
}

/// A family of factors given one at a time with ambient Jacobians, as a user of Ceres writes them.
/// Derived supplies
///
///     bool EvaluateOne(int i, const double* const* parameters, double* residuals,
///                      double** jacobians) const;
///
/// with Ceres's conventions: `jacobians` is null for a cost-only call; jacobians[s] is null for a
/// constant, otherwise row-major residual_size × ambient_size; false means "cannot be evaluated
/// here". Outputs are filled beforehand with an impossible value and checked afterwards, so a
/// forgotten entry, a NaN or an infinity is reported with the factor's index, that of the first
/// factor at fault; but later ones of the same call may have been evaluated by then. Source: the
/// obligations of ceres::CostFunction::Evaluate (Ceres 2.1, residual_block.cc).
template <typename Derived>
class AmbientFamily : public FactorFamily {
 public:
  /// As FactorFamily.
  using FactorFamily::FactorFamily;

  /// Few: a user's function may take long.
  int TaskSize() const override { return 16; }

  /// Calls EvaluateOne for each factor, checks what it wrote and projects its Jacobians.
  EvaluationFailure Evaluate(const FactorBatch& batch) const override {
    if (batch.next >= 0) {
      derived().Prefetch(batch.next);
    }
    if (size() >= kManyFactors) {
      // All of them at once: one by one each would be waited for.
      for (int i = batch.begin; i < batch.end; ++i) {
        derived().Prefetch(i);
      }
    }
    if (batch.jacobians == nullptr) {
      return EvaluateResiduals(batch);
    }
    if (batch.kept != nullptr) {
      return EvaluateOrFetch(batch);
    }
    if (batch.zero_blocks != nullptr) {
      return EvaluateNonzero(batch);
    }
    return IsInPlace(batch) ? EvaluateInPlace(batch) : EvaluateAndProject(batch);
  }

  /// Asks for the memory of a factor that is evaluated soon (FactorBatch::next). Here nothing;
  /// Derived may have its own.
  void Prefetch(int /*i*/) const {}

 private:
  static constexpr const char* kReturnedFalse = "the cost function returned false";
  static constexpr const char* kBadResidual = "a residual is not finite or was not written";
  static constexpr const char* kBadJacobian = "a Jacobian entry is not finite or was not written";
  // From so many on what Derived keeps of a factor is mostly not in the cache.
  static constexpr int kManyFactors = 1 << 15;

  EvaluationFailure EvaluateResiduals(const FactorBatch& batch) const {
    MarkResiduals(batch);
    const double* const* parameters = Parameters(batch);
    double* residuals = Residuals(batch);
    const int num_slots = this->num_slots();
    const int rows = residual_size();
    const int end = batch.end;
    for (int i = batch.begin; i < end; ++i, parameters += num_slots, residuals += rows) {
      if (!derived().EvaluateOne(i, parameters, residuals, nullptr)) {
        return FirstFault(batch, i, {i, kReturnedFalse});
      }
    }
    return FirstFault(batch, batch.end, {});
  }

  // Factor after factor writes its Jacobians, then those of a few factors are taken over together.
  EvaluationFailure EvaluateAndProject(const FactorBatch& batch) const {
    internal::AmbientScratch scratch(*this, batch, internal::kMostTaken);
    MarkResiduals(batch);
    const TangentMap* const* maps = Maps(batch);
    for (int first = batch.begin; first < batch.end;) {
      const int end = first + CountAlike(maps, std::min(scratch.group, batch.end - first));
      const int reached = EvaluateGroup(batch, first, end, &scratch);
      const EvaluationFailure bad = TakeGroup(maps, first, reached - first, &scratch);
      if (bad.failed()) {
        return FirstFault(batch, bad.factor + 1, bad);
      }
      if (reached < end) {
        return FirstFault(batch, reached, {reached, kReturnedFalse});
      }
      maps += static_cast<std::ptrdiff_t>(end - first) * num_slots();
      first = end;
    }
    return FirstFault(batch, batch.end, {});
  }

  // One by one, whose Jacobians then lie together: of many blocks, hardly any of which is not zero,
  // each takes a few instructions.
  EvaluationFailure EvaluateNonzero(const FactorBatch& batch) const {
    internal::AmbientScratch scratch(*this, batch, 1);
    MarkResiduals(batch);
    const int num_slots = this->num_slots();
    const TangentMap* const* maps = Maps(batch);
    const double* const* parameters = Parameters(batch);
    double* residuals = Residuals(batch);
    for (int i = batch.begin; i < batch.end; ++i) {
      double** const blocks = scratch.outputs.blocks;
      for (int s = 0; s < num_slots; ++s) {
        blocks[s] =
            maps[s]->kind == TangentMap::Kind::kConstant ? nullptr : scratch.slots[s].values;
      }
      if (scratch.size > 0) {
        internal::MarkManyUnwritten(scratch.slots[0].values, scratch.size);
      }
      if (!derived().EvaluateOne(i, parameters, residuals, blocks)) {
        return FirstFault(batch, i, {i, kReturnedFalse});
      }
      const int bad =
          internal::TakeNonzero(scratch.slots, maps, num_slots, scratch.size, i - batch.begin,
                                batch.zero_blocks + std::ptrdiff_t{i} * num_slots);
      if (bad >= 0) {
        const internal::AmbientSlot& slot = scratch.slots[bad];
        return FirstFault(batch, i + 1, BadJacobian(i, bad, slot.values, slot.size));
      }
      maps += num_slots;
      parameters += num_slots;
      residuals += residual_size();
    }
    return FirstFault(batch, batch.end, {});
  }

  // One by one, which allows for anything to be kept; a fault ends it.
  EvaluationFailure EvaluateOrFetch(const FactorBatch& batch) const {
    double* blocks[internal::kMostKeptSlots];
    const double* const* parameters = Parameters(batch);
    double* residuals = Residuals(batch);
    const int rows = residual_size();
    for (int i = batch.begin; i < batch.end; ++i, parameters += num_slots(), residuals += rows) {
      const bool is_new = !internal::FetchKept(batch, i, blocks);
      if (is_new && !derived().EvaluateOne(i, parameters, residuals, blocks)) {
        return {i, kReturnedFalse};
      }
      if (is_new && !AreWritten(residuals, rows)) {
        const int r = FirstUnwritten(residuals, rows);
        return {i, kBadResidual, -1, r, residuals[r]};
      }
      const double* J = nullptr;
      const int s = internal::TakeKept(batch, i, is_new, &J);
      if (s >= 0) {
        return BadJacobian(i, s, J, rows * slot(s).ambient_size);
      }
    }
    return {};
  }

  // How many of `most` factors have maps like those of the first one, slot by slot.
  int CountAlike(const TangentMap* const* maps, int most) const {
    const int num_slots = this->num_slots();
    const int num_entries = most * num_slots;
    int k = num_slots;
    // Neighbors mostly share their maps, but for one slot.
    while (k < num_entries &&
           (maps[k] == maps[k - num_slots] || maps[k]->IsLike(*maps[k - num_slots]))) {
      ++k;
    }
    return k < num_entries ? k / num_slots : most;
  }

  // The factors from first to end, whose maps are alike, or to one that returns false, which is
  // returned.
  int EvaluateGroup(const FactorBatch& batch, int first, int end,
                    internal::AmbientScratch* scratch) const {
    const int num_slots = this->num_slots();
    const TangentMap* const* maps =
        batch.tangent_maps + static_cast<std::ptrdiff_t>(first) * num_slots;
    for (int s = 0; s < num_slots; ++s) {
      // What is unwanted is asked for all the same: code that never met a constant may not look for
      // a null pointer.
      const internal::AmbientSlot& slot = scratch->slots[s];
      const bool constant = maps[s]->kind == TangentMap::Kind::kConstant;
      scratch->outputs.next[s] = constant ? nullptr : slot.values;
      scratch->outputs.strides[s] = constant ? 0 : slot.size;
      if (!constant) {
        internal::MarkManyUnwritten(slot.values, (end - first) * slot.size);
      }
    }
    return EvaluateEach(batch, first, end, scratch->outputs);
  }

  // The factors from first to end, or to one that returns false, which is returned.
  int EvaluateEach(const FactorBatch& batch, int first, int end,
                   const internal::AmbientOutputs& outputs) const {
    return internal::WithConstantSize(num_slots(), [this, &batch, first, end, outputs](auto count) {
      const int rows = residual_size();
      const double* const* parameters =
          batch.parameters + static_cast<std::ptrdiff_t>(first) * count;
      double* residuals = batch.residuals + static_cast<std::ptrdiff_t>(first) * rows;
      for (int i = first; i < end; ++i, parameters += count, residuals += rows) {
        for (int s = 0; s < count; ++s) {
          outputs.blocks[s] = outputs.next[s];
          outputs.next[s] += outputs.strides[s];
        }
        if (!derived().EvaluateOne(i, parameters, residuals, outputs.blocks)) {
          return i;
        }
      }
      return end;
    });
  }

  // Of `count` factors from first on; of several with a bad Jacobian the first.
  EvaluationFailure TakeGroup(const TangentMap* const* maps, int first, int count,
                              internal::AmbientScratch* scratch) const {
    EvaluationFailure failure;
    for (int s = 0; s < num_slots(); ++s) {
      internal::AmbientSlot& slot = scratch->slots[s];
      const int bad = internal::TakeAlike(slot, maps + s, num_slots(), count);
      if (bad >= 0) {
        failure =
            BadJacobian(first + bad, s, slot.values + std::ptrdiff_t{bad} * slot.size, slot.size);
        count = bad;
      }
      slot.J_tangent += count * slot.factor_stride;
    }
    return failure;
  }

  // Whether all factors have the same maps, and Jacobians of one row that are their own tangent
  // ones, as in curve fitting.
  bool IsInPlace(const FactorBatch& batch) const {
    const int num_slots = this->num_slots();
    if (residual_size() != 1 || num_slots > static_cast<int>(internal::kInlineSlots) ||
        batch.begin == batch.end) {
      return false;
    }
    const TangentMap* const* maps = Maps(batch);
    for (int s = 0; s < num_slots; ++s) {
      if (maps[s]->kind != TangentMap::Kind::kIdentity &&
          maps[s]->kind != TangentMap::Kind::kConstant) {
        return false;
      }
    }
    return std::equal(maps,
                      maps + static_cast<std::ptrdiff_t>(batch.end - batch.begin - 1) * num_slots,
                      maps + num_slots);
  }

  // Neighboring entries of the rows of such Jacobians.
  struct Run {
    double* first;  // of the batch's first factor
    std::ptrdiff_t stride;
    int size;
  };

  // As few runs as cover all wanted Jacobians; returns their number.
  int FindRuns(const FactorBatch& batch, Run* runs) const {
    int num_runs = 0;
    for (int s = 0; s < num_slots(); ++s) {
      if (!Maps(batch)[s]->wanted()) {
        continue;
      }
      const JacobianView& view = batch.jacobians[s];
      const Run run = {view.data + batch.begin * view.factor_stride, view.factor_stride,
                       slot(s).ambient_size};
      Run* const last = num_runs > 0 ? &runs[num_runs - 1] : nullptr;
      if (last != nullptr && last->first + last->size == run.first && last->stride == run.stride) {
        last->size += run.size;
      } else {
        runs[num_runs++] = run;
      }
    }
    return num_runs;
  }

  // Such Jacobians are written straight to their places.
  EvaluationFailure EvaluateInPlace(const FactorBatch& batch) const {
    // as IsInPlace has seen
    const int num_slots = std::min(this->num_slots(), static_cast<int>(internal::kInlineSlots));
    double* blocks[internal::kInlineSlots];
    double* next[internal::kInlineSlots];
    std::ptrdiff_t strides[internal::kInlineSlots];
    for (int s = 0; s < num_slots; ++s) {
      const bool wanted = Maps(batch)[s]->wanted();
      strides[s] = wanted ? batch.jacobians[s].factor_stride : 0;
      next[s] = wanted ? batch.jacobians[s].data + batch.begin * strides[s] : nullptr;
    }
    Run runs[internal::kInlineSlots];
    const int num_runs = FindRuns(batch, runs);
    for (const Run* run = runs; run != runs + num_runs; ++run) {
      internal::WithConstantSize(run->size, [run, &batch](auto size) {
        double* row = run->first;
        for (int i = batch.begin; i < batch.end; ++i, row += run->stride) {
          MarkUnwritten(row, size);
        }
      });
    }
    MarkResiduals(batch);
    const int i = EvaluateEach(batch, batch.begin, batch.end, {blocks, next, strides});
    const EvaluationFailure returned_false = {i, kReturnedFalse};
    return FirstFaultInPlace(batch, runs, num_runs, i,
                             i < batch.end ? returned_false : EvaluationFailure());
  }

  // Of the batch's first factor.
  const double* const* Parameters(const FactorBatch& batch) const {
    return batch.parameters + static_cast<std::ptrdiff_t>(batch.begin) * num_slots();
  }
  const TangentMap* const* Maps(const FactorBatch& batch) const {
    return batch.tangent_maps + static_cast<std::ptrdiff_t>(batch.begin) * num_slots();
  }
  double* Residuals(const FactorBatch& batch) const {
    return batch.residuals + static_cast<std::ptrdiff_t>(batch.begin) * residual_size();
  }
  const Derived& derived() const { return static_cast<const Derived&>(*this); }

  void MarkResiduals(const FactorBatch& batch) const {
    MarkUnwritten(Residuals(batch), (batch.end - batch.begin) * residual_size());
  }

  // The first factor before `end` with a bad residual; without one `failure`, which is of a factor
  // behind them.
  EvaluationFailure FirstFault(const FactorBatch& batch, int end, EvaluationFailure failure) const {
    const double* residuals = Residuals(batch);
    if (AreWritten(residuals, (end - batch.begin) * residual_size())) {
      return failure;
    }
    int i = batch.begin;
    while (AreAllWritten(residuals, residual_size())) {
      ++i;
      residuals += residual_size();
    }
    const int r = FirstUnwritten(residuals, residual_size());
    return {i, kBadResidual, -1, r, residuals[r]};
  }

  // The index of the first entry that is not finite or was not written; −1 if it can no longer be
  // told.
  static int FirstUnwritten(const double* values, int count) {
    for (int k = 0; k < count; ++k) {
      if (!AreAllWritten(values + k, 1)) {
        return k;
      }
    }
    return -1;
  }

  static EvaluationFailure BadJacobian(int factor, int slot, const double* J, int count) {
    const int entry = FirstUnwritten(J, count);
    return {factor, kBadJacobian, slot, entry, entry < 0 ? 0.0 : J[entry]};
  }

  // Of Jacobians in their places, all of one row.
  EvaluationFailure BadJacobianInPlace(const FactorBatch& batch, int factor) const {
    for (int s = 0; s < num_slots(); ++s) {
      const double* row = batch.jacobians[s].data + factor * batch.jacobians[s].factor_stride;
      if (Maps(batch)[s]->wanted() && !AreAllWritten(row, slot(s).ambient_size)) {
        return BadJacobian(factor, s, row, slot(s).ambient_size);
      }
    }
    return {factor, kBadJacobian};
  }

  EvaluationFailure FirstFaultInPlace(const FactorBatch& batch, const Run* runs, int num_runs,
                                      int end, EvaluationFailure failure) const {
    int first_bad = end;
    for (const Run* run = runs; run != runs + num_runs; ++run) {
      if (IsOrdinary(*run, end - batch.begin)) {
        continue;
      }
      internal::WithConstantSize(run->size, [run, &batch, &first_bad](auto size) {
        const double* row = run->first;
        for (int i = batch.begin; i < first_bad; ++i, row += run->stride) {
          if (!AreWritten(row, size)) {
            first_bad = i;
          }
        }
      });
    }
    return first_bad == end
               ? FirstFault(batch, end, failure)
               : FirstFault(batch, first_bad + 1, BadJacobianInPlace(batch, first_bad));
  }

  // Whether that is shown by a look at all that lies between its first entry and its last, where it
  // is little more than its own.
  static bool IsOrdinary(const Run& run, int num_rows) {
    return run.stride <= 4 * run.size &&
           AreAllWritten(run.first, (num_rows - 1) * static_cast<int>(run.stride) + run.size);
  }
};

}  // namespace inceres
