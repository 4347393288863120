#include "linear/block_jacobi.h"

#include <algorithm>

#include "linear/small_cholesky.h"

namespace inceres::internal {

// Block Jacobi for the incremental PCG (docs/algorithms.md, "Reduced linear systems"; ICE-BA). Kept
// between calls: per block row M_i = S_ii + diag(damping), and -M_i⁻¹, which is formed through the
// Cholesky factor and stored negated, because the kernel subtracts. M_i itself is kept as well,
// whole and padded: the product with A takes its diagonal blocks from here.
//
// A held row, and a row that was removed, has size 0: it has no block, and neither product touches
// its part of a vector. A row stays on the list of stale ones until it has been inverted, so that
// after a failure the next call tries it again.

int BlockJacobi::Update(const ReducedMatrix& A, const ReducedSolver::Rows& changed) {
  const SymmetricBlockRows& S = *A.rows();
  // Rows that came since the last call are stale whether or not they are among the changed ones.
  const int known_rows = std::min(num_rows(), S.num_rows());
  const int first = std::min(changed.first_row, known_rows);
  blocks_.resize(S.num_rows());
  // Sizes before the first changed row are as they were, and so are the offsets.
  FindOffsets(S, first);
  if (changed.rows != nullptr) {
    stale_.insert(stale_.end(), changed.rows->begin(), changed.rows->end());
  }
  for (int row = changed.rows != nullptr ? known_rows : first; row < S.num_rows(); ++row) {
    stale_.push_back(row);
  }
  num_inverted_ = 0;
  // Popped after the work: the row that fails is still the last one on the list.
  for (; !stale_.empty(); stale_.pop_back()) {
    const int row = stale_.back();
    if (row >= S.num_rows()) {
      continue;  // the rows have been compacted since
    }
    blocks_[row].size = A.constant() != nullptr && A.constant()[row] != 0 ? 0 : S.size_of(row);
    if (!Invert(A, row)) {
      return row;
    }
    num_inverted_ += IsFree(row);
  }
  return kNone;
}

void BlockJacobi::FindOffsets(const SymmetricBlockRows& S, int first_row) {
  // Entry first_row is the sum of the sizes before it, which have not changed.
  packed_.resize(first_row + 1);
  padded_.resize(first_row + 1);
  for (int row = first_row; row < S.num_rows(); ++row) {
    packed_.push_back(packed_.back() + S.size_of(row));
    padded_.push_back(padded_.back() + PadToQuad(S.size_of(row)));
  }
}

bool BlockJacobi::Invert(const ReducedMatrix& A, int row) {
  Block& block = blocks_[row];
  const int size = block.size;
  const int stride = PadToQuad(size);
  if (size == 0) {
    return true;
  }
  // The diagonal block is the last one of its row.
  const double* S_ii = A.rows()->values(A.rows()->row(row).back().offset);
  block.M.assign(static_cast<std::size_t>(size) * stride, 0.0);
  for (int r = 0; r < size; ++r) {
    // Of a diagonal block the lower triangle counts; both are written here.
    for (int c = 0; c <= r; ++c) {
      block.M[r * stride + c] = block.M[c * stride + r] = S_ii[r * stride + c];
    }
    block.M[r * stride + r] += A.diagonal()[packed_[row] + r];
  }
  // The factor takes the place of what it is made from: M stays for SubtractProduct.
  L_.assign(block.M.begin(), block.M.end());
  inverse_pivots_.resize(size);
  block.minus_inverse.resize(block.M.size());
  return NegateInverse(size, L_.data(), stride, inverse_pivots_.data(), stride,
                       block.minus_inverse.data());
}

void BlockJacobi::SubtractProduct(const double* v, double* y) const {
  const Kernels& kernels = BestKernels();
  for (int i = 0; i < num_rows(); ++i) {
    const int stride = PadToQuad(blocks_[i].size);
    kernels.subtract_row_dots(blocks_[i].size, 1, stride, blocks_[i].M.data(), stride,
                              v + padded_[i], stride, y + padded_[i], 1);
  }
}

void BlockJacobi::Apply(const double* r, double* z) const {
  const Kernels& kernels = BestKernels();
  // Zeros also where a row is held: there M⁻¹ r is nothing.
  std::fill_n(z, padded_.back(), 0.0);
  for (int i = 0; i < num_rows(); ++i) {
    const int stride = PadToQuad(blocks_[i].size);
    kernels.subtract_row_dots(blocks_[i].size, 1, stride, blocks_[i].minus_inverse.data(), stride,
                              r + padded_[i], stride, z + padded_[i], 1);
  }
}

std::size_t BlockJacobi::Bytes() const {
  std::size_t bytes = blocks_.capacity() * sizeof(Block) +
                      (packed_.capacity() + padded_.capacity() + stale_.capacity()) * sizeof(int);
  for (const Block& block : blocks_) {
    bytes += (block.M.capacity() + block.minus_inverse.capacity()) * sizeof(double);
  }
  return bytes;
}

}  // namespace inceres::internal
