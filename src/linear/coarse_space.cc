#include "linear/coarse_space.h"

#include <algorithm>
#include <functional>
#include <utility>

namespace inceres::internal {

// The coarse half of the two-level preconditioner (docs/algorithms.md, "Reduced linear systems",
// two levels). With Q = V (VᵀA V)⁻¹ Vᵀ and D⁻¹ the blocks,
//
//     M⁻¹ = (I − Q A) D⁻¹ (I − A Q) + Q
//
// is applied in three steps, of which the caller does the second:
//
//     q = (VᵀA V)⁻¹ Vᵀ r,   y = r − A V q                   Deflate
//     z = D⁻¹ y
//     z + V (q − (VᵀA V)⁻¹ (A V)ᵀ z) = (I − Q A) z + Q r    AddCoarse
//
// Two solves with the coarse factor, and no product with A. q is kept from the first step to the
// last, so calls come in pairs.
//
// Q A Q = Q holds up to rounding only, but M⁻¹ is symmetric and positive definite for any symmetric
// positive definite inverse of VᵀA V (Mandel 1993): a small regularization does no harm.

namespace {

// Added to the diagonal of VᵀA V, whose columns of V have unit length in the norm of N: what
// rounding leaves of directions without curvature. More where it is not enough.
// Curvatures of such columns are of the order of 1, which is the unit of these numbers.
constexpr double kRegularization = 1e-13;
constexpr double kMoreRegularization = 1e3;
constexpr int kTrials = 4;

}  // namespace

// The symbolic analysis is done once for a pattern; values and diagonal are there before Factorize
// only.
CoarseFactor::CoarseFactor(BlockPattern pattern, const Executor& executor, Status* status)
    : pattern_(std::move(pattern)), factor_(executor) {
  values_.resize(static_cast<std::size_t>(pattern_.value_begin.back()));
  diagonal_.resize(pattern_.size());
  *status = factor_.Analyze(ReducedMatrix(pattern_, nullptr, nullptr));
}

// The values stay as they are and the diagonal goes in by itself, so that another try forms nothing
// anew.
Status CoarseFactor::Factorize() {
  Status status;
  double regularization = kRegularization;
  for (int trial = 0; trial < kTrials; ++trial, regularization *= kMoreRegularization) {
    for (int a = 0; a < pattern_.num_blocks(); ++a) {
      const int width = pattern_.block_size(a);
      // The diagonal block is the last one of its row.
      const double* const block =
          values_.data() + pattern_.value_begin[pattern_.row_begin[a + 1] - 1];
      // A zero on the diagonal of VᵀA V is exact: that column of V was set to zero, and its entries
      // of q are zero.
      for (int k = 0; k < width; ++k) {  // a column without entries stands for itself
        diagonal_[pattern_.offsets[a] + k] = block[k * width + k] == 0.0 ? 1.0 : regularization;
      }
    }
    status = factor_.Factorize(ReducedMatrix(pattern_, values_.data(), diagonal_.data()), {});
    if (status.ok()) {
      break;
    }
  }
  // That of the last trial: the caller has to do without.
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

// Once V and A V have been written for the A at hand: for another damping A V is another.
Status CoarseSpace::Factorize() {
  FormGalerkin(factor_.pattern(), factor_.values());
  return factor_.Factorize();
}

// Vᵀ y = 0 afterwards, up to rounding: D⁻¹ gets what the coarse columns cannot see.
void CoarseSpace::Deflate(const double* r, double* y) {
  Restrict(r, restricted_.data());
  factor_.Solve(restricted_.data(), q_.data());
  SubtractProducts(q_.data(), r, y);
}

// (A V)ᵀ z is VᵀA z, since A is symmetric.
void CoarseSpace::AddCoarse(double* z) {
  RestrictProducts(z, restricted_.data());
  factor_.Solve(restricted_.data(), correction_.data());
  // q less the correction: both parts go up in one pass over V.
  std::transform(q_.begin(), q_.end(), correction_.begin(), correction_.begin(), std::minus<>());
  Prolong(correction_.data(), z);
}

std::int64_t CoarseSpace::Bytes() const {
  return CoarseColumns::Bytes() + factor_.Bytes() +
         static_cast<std::int64_t>(3 * q_.size() * sizeof(double));
}

}  // namespace inceres::internal
