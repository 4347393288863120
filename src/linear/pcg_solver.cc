#include "linear/pcg_solver.h"

#include <algorithm>
#include <numeric>
#include <sstream>

#include "linear/not_positive_definite.h"
#include "linear/small_cholesky.h"

namespace inceres::internal {

// The incremental PCG (docs/algorithms.md, "Reduced linear systems", when PCG ends; ICE-BA). Kept
// between calls: the blocks of M and their inverses, and in the caller's x what the last solution
// has left to apply, from which the iteration starts.
//
// The end. Iteration k adds the gain ½ α_k rᵀz to the decrease, and the squared error of x in the
// norm of the energy is twice the sum of the gains to come. They are not known, but the sum of the
// last few is a bound of the error some iterations back, and convergence makes that a bound of the
// error now (Hestenes & Stiefel 1952, theorem 6:1; Strakoš & Tichý 2002). x ends when that sum is
// below η² of the whole decrease.
//
// S is read by blocks on the calling thread: one thread, one order of every sum.
//
// Per block row there is M_i = S_ii + diag(damping), whole and padded: the product with A takes its
// diagonal blocks from here. And there is −M_i⁻¹, which is formed through the Cholesky factor and
// stored negated, because the kernel subtracts.
//
// A held row, and a row that was removed, has size 0: it has no block in M, its blocks in S are
// passed over, and no product touches its part of a vector. A row stays on the list of stale ones
// until it has been inverted, so that after a failure the next call tries it again.

namespace {

constexpr int kMinWindow = 6;  // iterations the estimate of the error looks back
// or this share of the iterations so far: slow convergence has long plateaus
constexpr double kWindowShare = 0.25;

}  // namespace

Status PcgSolver::Factorize(const ReducedMatrix& A, const Rows& changed) {
  // The values are read where S has them; of a factorization there is only the preconditioner.
  S_ = A.rows();
  work_ = Work();
  work_.factored_rows = 0;
  factored_ = InvertChanged(A, changed);
  return factored_;
}

Status PcgSolver::InvertChanged(const ReducedMatrix& A, const Rows& changed) {
  // Rows that came since the last call are stale whether or not they are among the changed ones.
  const int known_rows = std::min(num_rows(), S_->num_rows());
  const int first = std::min(changed.first_row, known_rows);
  blocks_.resize(S_->num_rows());
  // Sizes before the first changed row are as they were, and so are the offsets.
  FindOffsets(first);
  if (changed.rows != nullptr) {
    stale_.insert(stale_.end(), changed.rows->begin(), changed.rows->end());
  }
  for (int row = changed.rows != nullptr ? known_rows : first; row < num_rows(); ++row) {
    stale_.push_back(row);
  }
  // Popped after the work: the row that fails is still the last one on the list.
  for (; !stale_.empty(); stale_.pop_back()) {
    const int row = stale_.back();
    if (row >= num_rows()) {
      continue;  // the rows have been compacted since
    }
    blocks_[row].size = A.constant() != nullptr && A.constant()[row] != 0 ? 0 : S_->size_of(row);
    if (!Invert(A, row)) {
      return NotPositiveDefinite(row, &work_);
    }
    work_.factored_rows += IsFree(row);
  }
  return Status::Ok();
}

void PcgSolver::FindOffsets(int first_row) {
  // Entry first_row is the sum of the sizes before it, which have not changed.
  packed_.resize(first_row + 1);
  padded_.resize(first_row + 1);
  for (int row = first_row; row < num_rows(); ++row) {
    packed_.push_back(packed_.back() + S_->size_of(row));
    padded_.push_back(padded_.back() + PadToQuad(S_->size_of(row)));
  }
}

bool PcgSolver::Invert(const ReducedMatrix& A, int row) {
  Block& block = blocks_[row];
  const int size = block.size;
  const int stride = PadToQuad(size);
  if (size == 0) {
    return true;
  }
  // The diagonal block is the last one of its row.
  const double* S_ii = S_->values(S_->row(row).back().offset);
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

Status PcgSolver::Solve(const double* b, const Rows& /*changed_b*/,
                        const Truncation& /*truncation*/, double* x) {
  if (!factored_.ok()) {
    return factored_;
  }
  iteration_.Resize(padded_.back());
  PadFree(b, iteration_.b());
  // Held rows begin, and stay, at zero: x of a frame that does not move.
  PadFree(x, iteration_.x());
  // It compares what x promises with zero, so that a stale x does no harm.
  iteration_.StartFromX(*this);
  const ConjugateGradients::End end = iteration_.Iterate(this, options_.max_iterations);
  work_.iterations = static_cast<int>(iteration_.gains().size());
  // There is no half solve: every row of x is written.
  work_.forward_rows = 0;
  work_.solved_rows = num_rows();
  work_.converged = end == ConjugateGradients::End::kConverged;
  // Too many iterations are no error: x is a step downhill, and Work::converged says what it is.
  if (end == ConjugateGradients::End::kNotPositiveDefinite ||
      end == ConjugateGradients::End::kBreakdown) {
    std::ostringstream text;
    text << "the reduced system is not positive definite: PCG met the curvature "
         << iteration_.curvature() << " at iteration " << work_.iterations;
    return Status::Error(StatusCode::kSingular, text.str());
  }
  Unpad(iteration_.x(), x);
  return Status::Ok();
}

bool PcgSolver::Precondition(const double* r, double* z) {
  const Kernels& kernels = BestKernels();
  // Zeros also where a row is held: there M⁻¹ r is nothing.
  std::fill_n(z, padded_.back(), 0.0);
  for (int i = 0; i < num_rows(); ++i) {
    const int stride = PadToQuad(blocks_[i].size);
    kernels.subtract_row_dots(blocks_[i].size, 1, stride, blocks_[i].minus_inverse.data(), stride,
                              r + padded_[i], stride, z + padded_[i], 1);
  }
  return true;
}

bool PcgSolver::IsGoodEnough(const ConjugateGradients& iteration) const {
  const std::vector<double>& gains = iteration.gains();
  const auto count = static_cast<int>(gains.size());
  // The window grows with the iterations: where convergence has plateaus a short one would end on
  // the first.
  const int window = std::max(kMinWindow, static_cast<int>(kWindowShare * count));
  const double recent = std::accumulate(gains.end() - std::min(count, window), gains.end(), 0.0);
  // Fewer gains than the window are no estimate.
  return count >= window &&
         recent <= options_.relative_tolerance * options_.relative_tolerance * iteration.decrease();
}

void PcgSolver::SubtractProduct(const double* v, double* y) const {
  const Kernels& kernels = BestKernels();
  // The diagonal blocks with their damping, which S does not have.
  for (int i = 0; i < num_rows(); ++i) {
    const int stride = PadToQuad(blocks_[i].size);
    kernels.subtract_row_dots(blocks_[i].size, 1, stride, blocks_[i].M.data(), stride,
                              v + padded_[i], stride, y + padded_[i], 1);
  }
  for (int i = 0; i < num_rows(); ++i) {
    if (!IsFree(i)) {
      continue;
    }
    const int size = S_->size_of(i);
    for (const SymmetricBlockRows::Entry& entry : S_->row(i)) {
      const int j = entry.column;
      if (j == i || !IsFree(j)) {
        continue;
      }
      // Stored by rows the block is its transpose stored by columns.
      const double* block = S_->values(entry.offset);
      const int stride = PadToQuad(S_->size_of(j));
      kernels.subtract_row_dots(size, 1, stride, block, stride, v + padded_[j], stride,
                                y + padded_[i], 1);
      // One read of a block off the diagonal serves both halves: y_i −= S_ij v_j and y_j −= S_ijᵀ
      // v_i.
      kernels.subtract_outer(stride, 1, size, block, stride, v + padded_[i], 1, y + padded_[j],
                             stride);
    }
  }
}

void PcgSolver::PadFree(const double* packed, double* padded) const {
  std::fill_n(padded, padded_.back(), 0.0);
  for (int i = 0; i < num_rows(); ++i) {
    if (IsFree(i)) {
      std::copy(packed + packed_[i], packed + packed_[i + 1], padded + padded_[i]);
    }
  }
}

void PcgSolver::Unpad(const double* padded, double* packed) const {
  for (int i = 0; i < num_rows(); ++i) {
    std::copy_n(padded + padded_[i], packed_[i + 1] - packed_[i], packed + packed_[i]);
  }
}

std::size_t PcgSolver::Bytes() const {
  std::size_t bytes = iteration_.Bytes() + blocks_.capacity() * sizeof(Block) +
                      (packed_.capacity() + padded_.capacity() + stale_.capacity()) * sizeof(int);
  for (const Block& block : blocks_) {
    bytes += (block.M.capacity() + block.minus_inverse.capacity()) * sizeof(double);
  }
  return bytes;
}

}  // namespace inceres::internal
