#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "simd/kernels.h"

namespace inceres::internal {

/// Jacobians that are kept in single precision, in double again for the kernels, a few factors at a
/// time in a scratch that the cache holds. What a visitor is shown is of the shape that it would
/// have been given from Jacobians in double, and goes with its return.

/// out[k] = in[k].
inline void Widen(const float* __restrict in, std::ptrdiff_t count, double* __restrict out) {
  for (std::ptrdiff_t k = 0; k < count; ++k) {
    out[k] = static_cast<double>(in[k]);
  }
}

/// So many values: on the stack for the usual sizes, else on the heap. Not cleared.
template <typename T, std::size_t kInline>
class ScratchArray {
 public:
  T* Of(std::size_t count) {
    if (count <= kInline) {
      return stack_;
    }
    heap_.resize(std::max(heap_.size(), count));
    return heap_.data();
  }

 private:
  alignas(64) T stack_[kInline];
  std::vector<T> heap_;
};

/// A batch of factors, all slots.
class WidenedFactors {
 public:
  /// How many factors of these slots are a batch.
  int BatchOf(const SlotJacobians* slots, int num_slots) const;

  /// Widens `count` factors, at most a batch: the ids, or those from `first` on if null. Slot s of
  /// the k-th is at the k-th place of the result's s.
  const SlotJacobians* Take(const SlotJacobians* slots, int num_slots, const std::int32_t* ids,
                            int first, int count);

 private:
  static constexpr std::size_t kDoubles = 1024;
  static constexpr int kMaxBatch = 32;
  static constexpr std::size_t kSlots = 8;

  ScratchArray<double, kDoubles> values_;
  ScratchArray<SlotJacobians, kSlots> slots_;
};

/// The factors of a landmark, as the kernels want them; of one asked for twice in a row they are
/// still there, so Jacobians must not change meanwhile. Residuals are zeros where they are asked
/// for: Jᵀf of such families is Evaluator::strip_gradient.
class WidenedLandmarkFactors {
 public:
  /// visit(const LandmarkFactors&) once, with the factors themselves, where they are in double;
  /// else for one batch after the other.
  template <typename Visit>
  void ForEach(const LandmarkFactors& factors, const Visit& visit) {
    if (factors.count == 0 || factors.jacobians[0].single == nullptr) {
      visit(factors);
      return;
    }
    const int batch = widened_.BatchOf(factors.jacobians, factors.num_slots);
    for (int first = 0; first < factors.count; first += batch) {
      visit(Take(factors, first, std::min(batch, factors.count - first)));
    }
  }

 private:
  const LandmarkFactors& Take(const LandmarkFactors& factors, int first, int count);

  WidenedFactors widened_;
  LandmarkFactors taken_;
  const std::int32_t* ids_ = nullptr;  // of whom they are: each list has a place of its own
  ScratchArray<std::int32_t, 128> lists_;
  ScratchArray<double, 128> zeros_;
};

/// C += Σ_p B_pᵀ A_p where A and B are in single precision: `terms` count from these, blocks of A
/// and B have so many quads. a and b of `products` are not read; as b, null stands for a where the
/// products are symmetric.
void AccumulateWidened(const Kernels& kernels, const BlockProducts& products, const float* a,
                       std::ptrdiff_t a_quads, const float* b, std::ptrdiff_t b_quads, double* C);

/// What a pass over these rows yields, whichever precision they are in.
RowProducts MultiplyRows(const Kernels& kernels, const FactorRows& rows, const double* v);

/// A factor's block of a slot: where it is, or widened to `scratch`, which has room for it.
inline const double* BlockOf(const SlotJacobians& slot, std::ptrdiff_t factor,
                             std::vector<double>* scratch) {
  if (slot.single == nullptr) {
    return slot.data + factor * slot.factor_stride;
  }
  scratch->resize(std::max(scratch->size(), static_cast<std::size_t>(slot.factor_stride)));
  Widen(slot.single + factor * slot.factor_stride, slot.factor_stride, scratch->data());
  return scratch->data();
}

}  // namespace inceres::internal
