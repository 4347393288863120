#pragma once

#include <algorithm>

#include "inceres/linear/reduced_solver.h"

namespace inceres::internal {

/// A direct solver that knows what a step promises before it knows the step: with A = L Lᵀ and
/// y = L⁻¹b, bᵀA⁻¹b = yᵀy. Who looks for little left to gain, and finds it, need not substitute
/// backwards.
class HalfSolves {
 public:
  virtual ~HalfSolves() = default;
  /// Takes up b as ReducedSolver::Solve does, of the matrix that was factored last; sets *gain to
  /// ½ bᵀA⁻¹b. A Solve is told of what has changed since only. Returns Factorize's status.
  virtual Status SolveForGain(const double* b, const ReducedSolver::Rows& changed_b,
                              double* gain) = 0;
};

/// visit(row) of the rows that are meant, of an A with so many.
template <typename Visit>
void ForEachRow(const ReducedSolver::Rows& rows, int num_rows, const Visit& visit) {
  if (rows.rows != nullptr) {
    std::for_each(rows.rows->begin(), rows.rows->end(), visit);
    return;
  }
  for (int row = std::max(0, rows.first_row); row < num_rows; ++row) {
    visit(row);
  }
}

/// Whether a row of x, of `size` scalars, has moved away from what others were computed with: by
/// more than the threshold; without one, at all. NaN counts as a change. `weights_begin`: where the
/// row is in the weights.
inline bool HasChanged(const ReducedSolver::Truncation& truncation, int weights_begin,
                       const double* x, const double* passed_on, int size) {
  if (truncation.threshold <= 0.0) {
    return !std::equal(x, x + size, passed_on);
  }
  const double* const weights = truncation.weights + weights_begin;
  double change = 0.0;
  for (int k = 0; k < size; ++k) {
    const double difference = x[k] - passed_on[k];
    change += weights[k] * difference * difference;
  }
  return !(change <= truncation.threshold);
}

}  // namespace inceres::internal
