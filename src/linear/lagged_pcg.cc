#include "linear/lagged_pcg.h"

#include <algorithm>

#include "simd/kernels.h"

namespace inceres::internal {

Status LaggedPcg::Analyze(const ReducedMatrix& A) {
  factored_ = false;
  num_factorizations_ = 0;
  return factor_->Analyze(A);
}

Status LaggedPcg::Factorize(const ReducedMatrix& A, const Rows& /*changed*/) {
  A_ = A;
  return factored_ && work_.iterations <= kRenewAfter ? Status::Ok() : Renew();
}

Status LaggedPcg::Renew() {
  ++num_factorizations_;
  const Status status = factor_->Factorize(*A_, {});
  factored_ = status.ok();
  work_.iterations = 0;
  return status;
}

Status LaggedPcg::Solve(const double* b, const Rows& /*changed_b*/,
                        const Truncation& /*truncation*/, double* x) {
  if (!factored_) {
    return Status::Error(StatusCode::kSingular, "the reduced system is not factored");
  }
  const int size = A_->pattern().size();
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
