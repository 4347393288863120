#include "linear/lagged_pcg.h"

#include <algorithm>

#include "simd/kernels.h"

namespace inceres::internal {

// PCG with the factor M of an earlier A (docs/algorithms.md, "Reduced linear systems"; Nocedal &
// Wright, section 7.1). Near the minimum S changes little from one iteration to the next, so M⁻¹A
// is near the identity and a few products with A replace a factorization. Kept between calls: the
// factor and how many iterations the last solve took. Nothing is taken over of a solution: each
// solve begins with zero, so its result depends on A, M and b alone.
//
// Whatever goes wrong in the iteration, too slow, no curvature, not a number, has one answer:
// factor A itself and solve directly. That gives the right x or the right error.

Status LaggedPcg::Analyze(const ReducedMatrix& A) {
  factored_ = false;
  return factor_->Analyze(A);
}

Status LaggedPcg::Factorize(const ReducedMatrix& A, const Rows& /*changed*/) {
  // A view: the matrix stays as it is until the last Solve, as the contract of ReducedSolver has
  // it.
  A_ = A;
  // A last solve that took long tells that A has gone far from M: the factor is renewed now.
  return factored_ && work_.iterations <= kRenewAfter ? Status::Ok() : Renew();
}

Status LaggedPcg::Renew() {
  const Status status = factor_->Factorize(*A_, {});
  factored_ = status.ok();
  // The count is that of the factor: a new one has none against it.
  work_.iterations = 0;
  work_.failed_row = factor_->work().failed_row;
  return status;
}

Status LaggedPcg::Solve(const double* b, const Rows& /*changed_b*/,
                        const Truncation& /*truncation*/, double* x) {
  if (!factored_) {
    return Status::Error(StatusCode::kSingular, "the reduced system is not factored");
  }
  const int size = A_->pattern().size();
  // Packed vectors, with padding at the very end only.
  iteration_.Resize(PadToQuad(size));
  std::copy_n(b, size, iteration_.b());
  iteration_.StartFromZero();
  const ConjugateGradients::End end = iteration_.Iterate(this, kMaxIterations);
  work_.iterations = static_cast<int>(iteration_.gains().size());
  if (end != ConjugateGradients::End::kConverged) {
    const Status status = Renew();
    return status.ok() ? factor_->Solve(b, {}, {}, x) : status;
  }
  std::copy_n(iteration_.x(), size, x);
  return Status::Ok();
}

void LaggedPcg::SubtractProduct(const double* v, double* y) const {
  // One pass over the lower triangle, on the calling thread: a block (i, j) serves both y_i and
  // y_j.
  const BlockPattern& pattern = A_->pattern();
  for (int k = 0; k < pattern.size(); ++k) {
    y[k] -= A_->diagonal()[k] * v[k];
  }
  A_->ForEachBlock([&](int i, int j, const double* row, int stride) {
    const int top = pattern.offsets[i], left = pattern.offsets[j];
    for (int r = 0; r < pattern.block_size(i); ++r, row += stride) {
      // Of a diagonal block the lower triangle counts, its diagonal once.
      const int count = i == j ? r : pattern.block_size(j);
      double sum = i == j ? row[r] * v[top + r] : 0.0;
      for (int c = 0; c < count; ++c) {
        sum += row[c] * v[left + c];
        y[left + c] -= row[c] * v[top + r];
      }
      y[top + r] -= sum;
    }
  });
}

}  // namespace inceres::internal
