#pragma once

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

}  // namespace inceres::internal
