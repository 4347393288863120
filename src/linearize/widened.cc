#include "linearize/widened.h"

#include <numeric>

namespace inceres::internal {

// Widening (docs/algorithms.md, "Linearization", single precision). Kernels read doubles only. A
// batch is small enough for the first-level cache, so what a product has to bring from memory are
// floats, and the conversion hides behind that.

namespace {

// Blocks of one slot that are widened at a time.
constexpr int kMostTerms = 32;
constexpr std::size_t kBlockDoubles = 1024;

int TermsOf(std::ptrdiff_t quads) {
  return static_cast<int>(std::clamp<std::ptrdiff_t>(
      static_cast<std::ptrdiff_t>(kBlockDoubles) / (quads * kQuad), 1, kMostTerms));
}

}  // namespace

int WidenedFactors::BatchOf(const SlotJacobians* slots, int num_slots) const {
  const std::ptrdiff_t size = std::accumulate(
      slots, slots + num_slots, std::ptrdiff_t{0},
      [](std::ptrdiff_t sum, const SlotJacobians& slot) { return sum + slot.factor_stride; });
  return static_cast<int>(
      std::clamp<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(kDoubles) / size, 1, kMaxBatch));
}

const SlotJacobians* WidenedFactors::Take(const SlotJacobians* slots, int num_slots,
                                          const std::int32_t* ids, int first, int count) {
  SlotJacobians* const taken = slots_.Of(static_cast<std::size_t>(num_slots));
  std::ptrdiff_t size = 0;
  for (int s = 0; s < num_slots; ++s) {
    size += count * slots[s].factor_stride;
  }
  double* next = values_.Of(static_cast<std::size_t>(size));
  for (int s = 0; s < num_slots; ++s) {
    const std::ptrdiff_t stride = slots[s].factor_stride;
    taken[s] = slots[s];
    taken[s].data = next;
    taken[s].single = nullptr;
    for (int k = 0; k < count; ++k, next += stride) {
      Widen(slots[s].single + (ids != nullptr ? ids[k] : first + k) * stride, stride, next);
    }
  }
  return taken;
}

// Lists that are indexed by factor come along, for the k-th of the batch is factor k of it.
const LandmarkFactors& WidenedLandmarkFactors::Take(const LandmarkFactors& factors, int first,
                                                    int count) {
  const std::int32_t* const ids = factors.factors + first;
  if (ids == ids_) {
    return taken_;
  }
  ids_ = ids;
  const int num_slots = factors.num_slots;
  const auto num_entries = static_cast<std::size_t>(count) * static_cast<std::size_t>(num_slots);
  std::int32_t* const numbers = lists_.Of(2 * num_entries + static_cast<std::size_t>(count));
  std::int32_t* const targets = numbers + count;
  std::int32_t* const offsets = targets + num_entries;
  std::iota(numbers, targets, 0);
  for (int k = 0; k < count; ++k) {
    const std::ptrdiff_t entry = std::ptrdiff_t{ids[k]} * num_slots;
    std::copy_n(factors.y_targets + entry, num_slots, targets + k * num_slots);
    std::copy_n(factors.tangent_offsets + entry, num_slots, offsets + k * num_slots);
  }
  const auto num_residuals =
      static_cast<std::size_t>(count) * static_cast<std::size_t>(factors.residual_size);
  double* const zeros = zeros_.Of(num_residuals);
  std::fill_n(zeros, num_residuals, 0.0);
  taken_ = factors;
  taken_.jacobians = widened_.Take(factors.jacobians, num_slots, ids, 0, count);
  taken_.factors = numbers;
  taken_.count = count;
  taken_.residuals = zeros;
  taken_.y_targets = targets;
  taken_.tangent_offsets = offsets;
  return taken_;
}

void AccumulateWidened(const Kernels& kernels, const BlockProducts& products, const float* a,
                       std::ptrdiff_t a_quads, const float* b, std::ptrdiff_t b_quads, double* C) {
  ScratchArray<double, kBlockDoubles> of_a, of_b;
  ProductTerm terms[kMostTerms];
  const int batch = TermsOf(std::max(a_quads, b_quads));
  double* const A = of_a.Of(static_cast<std::size_t>(batch * a_quads * kQuad));
  double* const B = b == nullptr ? A : of_b.Of(static_cast<std::size_t>(batch * b_quads * kQuad));
  BlockProducts widened = products;
  widened.a = A;
  widened.b = B;
  widened.terms = terms;
  for (int first = 0; first < products.count; first += batch) {
    widened.count = std::min(batch, products.count - first);
    for (int k = 0; k < widened.count; ++k) {
      const ProductTerm& term = products.terms[first + k];
      terms[k] = {static_cast<std::int32_t>(k * a_quads), static_cast<std::int32_t>(k * b_quads)};
      Widen(a + std::ptrdiff_t{term.a} * kQuad, a_quads * kQuad, A + k * a_quads * kQuad);
      if (b != nullptr) {
        Widen(b + std::ptrdiff_t{term.b} * kQuad, b_quads * kQuad, B + k * b_quads * kQuad);
      }
    }
    kernels.accumulate_products(widened, 1.0, C);
  }
}

RowProducts MultiplyRows(const Kernels& kernels, const FactorRows& rows, const double* v) {
  if (rows.begin == rows.end || rows.jacobians[0].single == nullptr) {
    return kernels.row_products(rows, v);
  }
  WidenedFactors factors;
  const int batch = factors.BatchOf(rows.jacobians, rows.num_slots);
  RowProducts total;
  for (int first = rows.begin; first < rows.end; first += batch) {
    FactorRows widened = rows;
    widened.begin = 0;
    widened.end = std::min(batch, rows.end - first);
    widened.jacobians = factors.Take(rows.jacobians, rows.num_slots, nullptr, first, widened.end);
    widened.residuals = rows.residuals + std::ptrdiff_t{first} * rows.residual_size;
    widened.tangent_offsets = rows.tangent_offsets + std::ptrdiff_t{first} * rows.num_slots;
    const RowProducts part = kernels.row_products(widened, v);
    total.model_decrease += part.model_decrease;
    total.squared_norm += part.squared_norm;
  }
  return total;
}

}  // namespace inceres::internal
