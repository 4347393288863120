#include "linear/coarse_space.h"

#include <algorithm>
#include <functional>
#include <utility>

namespace inceres::internal {
namespace {

// Added to the diagonal of VᵀA V, whose columns of V have unit length in the norm of N: what
// rounding leaves of directions without curvature. More where it is not enough.
constexpr double kRegularization = 1e-13;
constexpr double kMoreRegularization = 1e3;
constexpr int kTrials = 4;

}  // namespace

CoarseFactor::CoarseFactor(BlockPattern pattern, const Executor& executor, Status* status)
    : pattern_(std::move(pattern)), factor_(executor) {
  values_.resize(static_cast<std::size_t>(pattern_.value_begin.back()));
  diagonal_.resize(pattern_.size());
  *status = factor_.Analyze(ReducedMatrix(pattern_, nullptr, nullptr));
}

Status CoarseFactor::Factorize() {
  Status status;
  double regularization = kRegularization;
  for (int trial = 0; trial < kTrials; ++trial, regularization *= kMoreRegularization) {
    for (int a = 0; a < pattern_.num_blocks(); ++a) {
      const int width = pattern_.block_size(a);
      const double* const block =
          values_.data() + pattern_.value_begin[pattern_.row_begin[a + 1] - 1];
      for (int k = 0; k < width; ++k) {  // a column without entries stands for itself
        diagonal_[pattern_.offsets[a] + k] = block[k * width + k] == 0.0 ? 1.0 : regularization;
      }
    }
    status = factor_.Factorize(ReducedMatrix(pattern_, values_.data(), diagonal_.data()), {});
    if (status.ok()) {
      break;
    }
  }
  return status;
}

std::int64_t CoarseFactor::Bytes() const {
  return static_cast<std::int64_t>((values_.size() + diagonal_.size()) * sizeof(double) +
                                   factor_.Bytes());
}

CoarseSpace::CoarseSpace(const std::vector<int>& offsets, CoarseShape shape,
                         const Executor& executor, Status* status)
    : CoarseColumns(offsets, std::move(shape), executor),
      factor_(GalerkinPattern(), executor, status) {
  for (std::vector<double>* vector : {&restricted_, &q_, &correction_}) {
    vector->resize(column_offsets().back());
  }
}

Status CoarseSpace::Factorize() {
  FormGalerkin(factor_.pattern(), factor_.values());
  return factor_.Factorize();
}

void CoarseSpace::Deflate(const double* r, double* y) {
  Restrict(r, restricted_.data());
  factor_.Solve(restricted_.data(), q_.data());
  SubtractProducts(q_.data(), r, y);
}

void CoarseSpace::AddCoarse(double* z) {
  RestrictProducts(z, restricted_.data());
  factor_.Solve(restricted_.data(), correction_.data());
  std::transform(q_.begin(), q_.end(), correction_.begin(), correction_.begin(), std::minus<>());
  Prolong(correction_.data(), z);
}

std::int64_t CoarseSpace::Bytes() const {
  return CoarseColumns::Bytes() + factor_.Bytes() +
         static_cast<std::int64_t>(3 * q_.size() * sizeof(double));
}

}  // namespace inceres::internal
