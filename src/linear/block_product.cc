#include "linear/block_product.h"

#include <numeric>

#include "simd/kernels.h"

namespace inceres::internal {

// y −= (A + diag) v with the lower triangle of A stored: conjugate gradients on an S that is
// formed, or on C. A row of y takes its blocks of the lower triangle as they are, and the blocks of
// its column below the diagonal transposed. A block off the diagonal is therefore read twice, once
// for either of its rows: that is the price of a sum that one task makes in one order, for equal
// bits with any number of threads. Scattering both halves in one pass would need the tasks to add
// into each other's rows.
//
// Blocks are those of a batch solve: packed, row-major, without padding, and of a diagonal block
// the whole square is read. Vectors are padded.

namespace {

constexpr int kRowGrain = 16;

}  // namespace

BlockProduct::BlockProduct(const BlockPattern& pattern)
    : rows_(pattern, /*keeps=*/[](int /*block*/) { return true; }) {
  for (int i = 0; i < pattern.num_blocks(); ++i) {
    packed_.push_back(packed_.back() + pattern.block_size(i));
    padded_.push_back(padded_.back() + PadToQuad(pattern.block_size(i)));
  }
}

void BlockProduct::Subtract(const std::vector<const double*>& blocks, const double* diagonal,
                            const Executor& executor, const double* v, double* y) const {
  executor.For(num_rows(), kRowGrain, [&](int begin, int end) {
    for (int row = begin; row < end; ++row) {
      SubtractRow(row, blocks, diagonal, v, y);
    }
  });
}

void BlockProduct::SubtractRow(int row, const std::vector<const double*>& blocks,
                               const double* diagonal, const double* v, double* y) const {
  const int size = block_size(row);
  double* const out = y + padded_[row];
  for (int k = rows_.begin[row]; k < rows_.begin[row + 1]; ++k) {
    const auto [block, column] = rows_.places[k];
    const double* entry = blocks[block];
    // A block that is known to be zero: in C most pairs of frames share no factor.
    if (entry == nullptr) {
      continue;
    }
    const int width = block_size(column);
    const double* const x = v + padded_[column];
    // Stored as it is needed: a row of the block times v.
    if (column <= row) {
      for (int r = 0; r < size; ++r, entry += width) {
        out[r] -= std::inner_product(entry, entry + width, x, 0.0);
      }
      continue;
    }
    // Stored as block (column, row), whose row c is column c of what is needed here. The inner loop
    // runs along memory and needs no sum across a register.
    for (int c = 0; c < width; ++c, entry += size) {
      for (int r = 0; r < size; ++r) {
        out[r] -= entry[r] * x[c];
      }
    }
  }
  SubtractDiagonal(row, diagonal, v, y);
}

void BlockProduct::SubtractDiagonal(int row, const double* diagonal, const double* v,
                                    double* y) const {
  for (int r = 0; r < block_size(row); ++r) {
    y[padded_[row] + r] -= diagonal[packed_[row] + r] * v[padded_[row] + r];
  }
}

void BlockProduct::SubtractDiagonal(const double* diagonal, const double* v, double* y) const {
  for (int row = 0; row < num_rows(); ++row) {
    SubtractDiagonal(row, diagonal, v, y);
  }
}

std::int64_t BlockProduct::Bytes() const {
  return static_cast<std::int64_t>(rows_.places.size() * sizeof(WholeRows::Place) +
                                   (packed_.size() + padded_.size() + rows_.begin.size()) *
                                       sizeof(int));
}

}  // namespace inceres::internal
