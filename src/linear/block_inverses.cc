#include "linear/block_inverses.h"

#include <algorithm>

#include "base/lowest_index.h"
#include "linear/small_cholesky.h"

namespace inceres::internal {

// M⁻¹ of block Jacobi (JACOBI and SCHUR_JACOBI of Ceres) by inverses of the blocks, not by their
// factors: applying an inverse is one product that the kernels do in whole quads, where two
// substitutions would wait for each other row by row. The inverses are stored negated, since the
// kernel subtracts: z = 0 - (-A⁻¹) r. A block is inverted through its Cholesky factor, so that a
// block that is not positive definite is noticed.
//
// Blocks are independent, and each writes to its own place: the same bits for any number of
// threads.

namespace {

constexpr int kBlockRowGrain = 32;

}  // namespace

int BlockInverses::Invert(const std::vector<int>& offsets, const std::vector<const double*>& blocks,
                          const double* diagonal, const Executor& executor) {
  // Places first, one after the other: rows of an inverse are padded to whole quads, and so are the
  // block rows of the vectors.
  const auto count = static_cast<int>(blocks.size());
  places_.resize(blocks.size());
  Place next;
  for (int i = 0; i < count; ++i) {
    next.size = offsets[i + 1] - offsets[i];
    places_[i] = next;
    next.padded += PadToQuad(next.size);
    next.begin += static_cast<std::int64_t>(next.size) * PadToQuad(next.size);
  }
  minus_inverses_.resize(static_cast<std::size_t>(next.begin));
  // Of several blocks that fail the lowest is named, whichever task met it first.
  LowestIndex singular(count);
  executor.For(count, kBlockRowGrain, [&](int begin, int end) {
    std::vector<double> scratch;
    for (int i = begin; i < end; ++i) {
      if (!InvertBlock(places_[i], blocks[i], diagonal + offsets[i], &scratch)) {
        singular.Note(i);
      }
    }
  });
  return singular.get() < count ? singular.get() : -1;
}

bool BlockInverses::InvertBlock(const Place& place, const double* block, const double* diagonal,
                                std::vector<double>* scratch) {
  const int size = place.size;
  // The block is copied, as its factor takes its place; the reciprocal pivots stand behind it.
  scratch->assign(block, block + static_cast<std::ptrdiff_t>(size) * size);
  scratch->resize(scratch->size() + static_cast<std::size_t>(size));
  double* const A = scratch->data();
  double* const inverse_pivots = A + static_cast<std::ptrdiff_t>(size) * size;
  for (int k = 0; k < size; ++k) {
    A[static_cast<std::ptrdiff_t>(k) * size + k] += diagonal[k];
  }
  return NegateInverse(size, A, size, inverse_pivots, PadToQuad(size),
                       minus_inverses_.data() + place.begin);
}

void BlockInverses::Apply(const Executor& executor, const double* r, double* z) const {
  const Kernels& kernels = BestKernels();
  executor.For(static_cast<int>(places_.size()), kBlockRowGrain, [&](int begin, int end) {
    for (int i = begin; i < end; ++i) {
      const Place& place = places_[i];
      const int stride = PadToQuad(place.size);
      // The kernel subtracts from what is there. The padding of r is zero, and that of z becomes
      // so.
      std::fill_n(z + place.padded, stride, 0.0);
      kernels.subtract_row_dots(place.size, 1, stride, minus_inverses_.data() + place.begin, stride,
                                r + place.padded, stride, z + place.padded, 1);
    }
  });
}

std::int64_t BlockInverses::Bytes() const {
  return static_cast<std::int64_t>(places_.size() * sizeof(Place) +
                                   minus_inverses_.size() * sizeof(double));
}

}  // namespace inceres::internal
