#include "linearize/strip_gradient.h"

#include <cstddef>
#include <cstdint>

namespace inceres::internal {

// g += Jᵀf while J is in double (docs/algorithms.md, "Linearization", single precision). Near the
// minimum g is a small difference of large terms: of a J that is rounded to single precision
// nothing would be left of it where the sum of magnitudes is 10⁷ times as large.
//
// Factors come in the order of the family, so factors of one variable are anywhere. Each task walks
// through all of them and adds what is of its own variables.

namespace {

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
