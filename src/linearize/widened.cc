#include "linearize/widened.h"

#include <algorithm>

namespace inceres::internal {

// Widening (docs/algorithms.md, "Linearization", single precision). Products of blocks have a
// kernel for each shape of tile, which all read doubles. A batch of blocks is small enough for the
// first-level cache, so what a product has to bring from memory are floats.

namespace {

// Blocks of one slot that are widened at a time.
constexpr int kMostTerms = 32;
constexpr int kBlockDoubles = 1024;

void Widen(const float* __restrict in, std::ptrdiff_t count, double* __restrict out) {
  for (std::ptrdiff_t k = 0; k < count; ++k) {
    out[k] = static_cast<double>(in[k]);
  }
}

int RowStride(int size, int unpadded_stride) {
  return unpadded_stride > 0 ? unpadded_stride : PadToQuad(size);
}

}  // namespace

void AccumulateWidened(const Kernels& kernels, const BlockProducts& products, const float* a,
                       const float* b, double* C) {
  const int a_size = products.depth * RowStride(products.a_size, products.a_stride);
  const int b_size = products.depth * RowStride(products.b_size, products.b_stride);
  // Of a block in the scratch; behind the last one there is a quad, for kernels read that far.
  const int stride = PadToQuad(std::max(a_size, b_size));
  const int batch = std::clamp(kBlockDoubles / stride, 1, kMostTerms);
  const int size = batch * stride + kQuad;
  alignas(64) double stack[2 * (kBlockDoubles + kQuad)];
  std::vector<double> heap(size <= kBlockDoubles + kQuad ? 0 : 2 * static_cast<std::size_t>(size));
  double* const A = heap.empty() ? stack : heap.data();
  double* const B = b == nullptr ? A : A + size;
  ProductTerm terms[kMostTerms];
  BlockProducts widened = products;
  widened.a = A;
  widened.b = B;
  widened.terms = terms;
  widened.is_near = true;
  for (int first = 0; first < products.count; first += batch) {
    widened.count = std::min(batch, products.count - first);
    for (int k = 0; k < widened.count; ++k) {
      const ProductTerm& term = products.terms[first + k];
      terms[k] = {k * stride / kQuad, k * stride / kQuad};
      Widen(a + std::ptrdiff_t{term.a} * kQuad, a_size, A + k * stride);
      if (b != nullptr) {
        Widen(b + std::ptrdiff_t{term.b} * kQuad, b_size, B + k * stride);
      }
    }
    kernels.accumulate_products(widened, 1.0, C);
  }
}

const double* WidenedBlock(const SlotJacobians& slot, std::ptrdiff_t record, int num_rows,
                           std::vector<double>* scratch) {
  if (slot.single == nullptr) {
    return slot.data + record * slot.factor_stride;
  }
  const std::ptrdiff_t count = std::ptrdiff_t{num_rows} * slot.row_stride;
  scratch->resize(std::max(scratch->size(), static_cast<std::size_t>(count)));
  Widen(slot.single + record * slot.factor_stride, count, scratch->data());
  return scratch->data();
}

}  // namespace inceres::internal
