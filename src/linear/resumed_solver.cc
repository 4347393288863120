#include "linear/resumed_solver.h"

#include <algorithm>

namespace inceres::internal {

Status ResumedSolver::Factorize(const SymmetricBlockRows& S, const double* damping, const char* held, const Change& change) {
  const int first = FirstRow(S, change);
  work_ = Work();
  work_.factor_flops = EnvelopeFlops(S, held, first, &workspace_);
  num_current_y_ = std::min(num_current_y_, first);
  num_passed_on_ = std::min(num_passed_on_, first);
  for (int i = first; i < cholesky_.num_rows(); ++i) {
    reached_before_ = std::min(reached_before_, cholesky_.FirstColumn(i));  // a row held now may have been coupled to many
  }
  factored_ = cholesky_.Factorize(S, damping, first, held);
  work_.factored_rows = cholesky_.num_valid_rows() - first;
  return factored_;
}

Status ResumedSolver::Solve(const double* b, int first_changed_b, const Truncation& truncation, double* x) {
  if (!factored_.ok()) {
    return factored_;
  }
  const int num_rows = cholesky_.num_rows();
  const std::vector<int>& offsets = cholesky_.offsets();
  const int first = std::min({num_current_y_, first_changed_b, num_rows});
  GrowTo(offsets.back());
  cholesky_.ForwardSubstitute(b, first, y_.data());
  num_current_y_ = num_rows;

  int filled = offsets.back();                     // rest_ is set up from here on
  int reached = std::min(first, reached_before_);  // the first row that must be found anew, as far as is known
  int row = num_rows;
  while (row > reached) {
    --row;
    CopyRest(offsets[cholesky_.FirstColumn(row)], &filled);
    cholesky_.BackSubstituteRow(row, rest_.data(), x);
    if (row >= num_passed_on_ || HasChanged(row, truncation, x)) {
      std::copy(x + offsets[row], x + offsets[row + 1], passed_on_.begin() + offsets[row]);
      reached = std::min(reached, cholesky_.FirstColumn(row));
    }
  }
  num_passed_on_ = num_rows;
  reached_before_ = num_rows;
  work_.forward_rows = num_rows - first;
  work_.solved_rows = num_rows - row;
  work_.first_solved_row = row;
  return Status::Ok();
}

// The row's alignment gap is written to as well: it may reach into the row before.
void ResumedSolver::CopyRest(int first_scalar, int* filled) {
  const int begin = std::min(*filled, first_scalar / kQuad * kQuad);
  std::copy(y_.begin() + begin, y_.begin() + *filled, rest_.begin() + begin);
  *filled = begin;
}

bool ResumedSolver::HasChanged(int row, const Truncation& truncation, const double* x) const {
  const int begin = cholesky_.offsets()[row];
  const int end = cholesky_.offsets()[row + 1];
  if (truncation.threshold <= 0.0) {
    return !std::equal(x + begin, x + end, passed_on_.begin() + begin);
  }
  double change = 0.0;
  for (int k = begin; k < end; ++k) {
    const double difference = x[k] - passed_on_[k];
    change += truncation.weights[k] * difference * difference;
  }
  return !(change <= truncation.threshold);
}

void ResumedSolver::GrowTo(int size) {
  if (static_cast<int>(y_.size()) < size) {
    y_.resize(size);
    rest_.resize(size);
    passed_on_.resize(size);
  }
}

std::size_t ResumedSolver::Bytes() const {
  return cholesky_.Bytes() + (y_.capacity() + rest_.capacity() + passed_on_.capacity()) * sizeof(double);
}

}  // namespace inceres::internal
