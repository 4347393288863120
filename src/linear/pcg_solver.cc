#include "linear/pcg_solver.h"

#include <algorithm>
#include <numeric>
#include <sstream>

#include "linear/not_positive_definite.h"

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
// S is read by blocks on the calling thread: one thread, one order of every sum. Held rows have no
// block in M, and their blocks in S are passed over.

namespace {

constexpr int kMinWindow = 6;  // iterations the estimate of the error looks back
// or this share of the iterations so far: slow convergence has long plateaus
constexpr double kWindowShare = 0.25;

}  // namespace

Status PcgSolver::Factorize(const ReducedMatrix& A, const Rows& changed) {
  // The values are read where S has them; of a factorization there is only the preconditioner.
  S_ = A.rows();
  const int failed = preconditioner_.Update(A, changed);
  work_ = Work();
  factored_ = failed == BlockJacobi::kNone ? Status::Ok() : NotPositiveDefinite(failed, &work_);
  work_.factored_rows = preconditioner_.num_inverted();
  return factored_;
}

Status PcgSolver::Solve(const double* b, const Rows& /*changed_b*/,
                        const Truncation& /*truncation*/, double* x) {
  if (!factored_.ok()) {
    return factored_;
  }
  iteration_.Resize(preconditioner_.padded_offsets().back());
  PadFree(b, iteration_.b());
  // Held rows begin, and stay, at zero: x of a frame that does not move.
  PadFree(x, iteration_.x());
  // It compares what x promises with zero, so that a stale x does no harm.
  iteration_.StartFromX(*this);
  const ConjugateGradients::End end = iteration_.Iterate(this, options_.max_iterations);
  work_.iterations = static_cast<int>(iteration_.gains().size());
  // There is no half solve: every row of x is written.
  work_.forward_rows = 0;
  work_.solved_rows = preconditioner_.num_rows();
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
  preconditioner_.Apply(r, z);
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
  const std::vector<int>& offsets = preconditioner_.padded_offsets();
  // The diagonal blocks with their damping, which S does not have.
  preconditioner_.SubtractProduct(v, y);
  for (int i = 0; i < S_->num_rows(); ++i) {
    if (!preconditioner_.IsFree(i)) {
      continue;
    }
    const int size = S_->size_of(i);
    for (const SymmetricBlockRows::Entry& entry : S_->row(i)) {
      const int j = entry.column;
      if (j == i || !preconditioner_.IsFree(j)) {
        continue;
      }
      // Stored by rows the block is its transpose stored by columns.
      const double* block = S_->values(entry.offset);
      const int stride = PadToQuad(S_->size_of(j));
      kernels.subtract_row_dots(size, 1, stride, block, stride, v + offsets[j], stride,
                                y + offsets[i], 1);
      // One read of a block off the diagonal serves both halves: y_i −= S_ij v_j and y_j −= S_ijᵀ
      // v_i.
      kernels.subtract_outer(stride, 1, size, block, stride, v + offsets[i], 1, y + offsets[j],
                             stride);
    }
  }
}

void PcgSolver::PadFree(const double* packed, double* padded) const {
  const std::vector<int>& from = preconditioner_.packed_offsets();
  const std::vector<int>& to = preconditioner_.padded_offsets();
  std::fill_n(padded, to.back(), 0.0);
  for (int i = 0; i < preconditioner_.num_rows(); ++i) {
    if (preconditioner_.IsFree(i)) {
      std::copy(packed + from[i], packed + from[i + 1], padded + to[i]);
    }
  }
}

void PcgSolver::Unpad(const double* padded, double* packed) const {
  const std::vector<int>& to = preconditioner_.packed_offsets();
  for (int i = 0; i < preconditioner_.num_rows(); ++i) {
    std::copy_n(padded + preconditioner_.padded_offsets()[i], to[i + 1] - to[i], packed + to[i]);
  }
}

}  // namespace inceres::internal
