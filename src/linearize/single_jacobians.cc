#include "linearize/single_jacobians.h"

#include <algorithm>
#include <cstdint>

namespace inceres::internal {

// Single precision (docs/algorithms.md, "Linearization").
//
// Widening: products of blocks have a kernel for each shape of tile, which all read doubles. A
// batch of blocks is small enough for the first-level cache, so what a product has to bring from
// memory are floats.
//
// The gradient: g += Jᵀf while J is in double. Near the minimum g is a small difference of large
// terms: of a J that is rounded to single precision nothing would be left of it where the sum of
// magnitudes is 10⁷ times as large. Factors come in the order of the family, so factors of one
// variable are anywhere. Each task walks through all of them and adds what is of its own variables.

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

// With threads: tasks of some variables each.
constexpr int kNumOwners = 8;

// y += J_sᵀ f, padding included.
void AddBlock(const double* J, const double* f, int num_rows, int row_stride, double* y) {
  for (int r = 0; r < num_rows; ++r, J += row_stride) {
    for (int c = 0; c < row_stride; ++c) {
      y[c] += J[c] * f[r];
    }
  }
}

// Neighboring variables have neighboring offsets, and factors of a strip few variables of a kind: a
// mix of the bits (Knuth's multiplicative hashing) spreads them over the tasks.
int OwnerOf(std::int32_t offset, int num_owners) {
  const std::uint32_t mixed = static_cast<std::uint32_t>(offset) * 2654435761U;
  return static_cast<int>((std::uint64_t{mixed} * static_cast<std::uint32_t>(num_owners)) >> 32);
}

void AddOfOwner(const Linearization& cache, int begin, int end, int owner, int num_owners,
                double* gradient) {
  for (int i = begin; i < end; ++i) {
    const std::int32_t* const offsets = cache.tangent_offsets.data() + cache.Entry(i);
    const double* const f =
        cache.WrittenResiduals() + static_cast<std::ptrdiff_t>(i) * cache.residual_size;
    for (int s = 0; s < cache.num_slots; ++s) {
      if (offsets[s] < 0 || OwnerOf(offsets[s], num_owners) != owner) {
        continue;
      }
      const SlotJacobians& slot = cache.slots[s];
      AddBlock(slot.data + i * slot.factor_stride, f, cache.residual_size, slot.row_stride,
               gradient + static_cast<std::ptrdiff_t>(offsets[s]) * kQuad);
    }
  }
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

void AddGradient(const Linearization& cache, int begin, int end, const Executor& executor,
                 double* gradient) {
  const int num_owners = executor.num_threads() > 1 ? kNumOwners : 1;
  executor.For(num_owners, 1, [&](int first, int last) {
    for (int owner = first; owner < last; ++owner) {
      AddOfOwner(cache, begin, end, owner, num_owners, gradient);
    }
  });
}

}  // namespace inceres::internal
