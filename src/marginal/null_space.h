#pragma once

#include <Eigen/Core>

#include "base/executor.h"
#include "inceres/linear/reduced_solver.h"

namespace inceres::internal {

/// The directions v in which vᵀ S v is next to nothing: orthonormal in units of a diagonal D, that
/// of C say, D^½ v, with eigenvalues of D^-½ S D^-½ of at most `threshold`, smallest first, and at
/// most `most` of them. Empty where S has no factor even when a ten-thousandth of D is added. By
/// subspace iteration with the sparse factor of S + ε D: one factorization and a few dozen solves.
/// Source: Golub & Van Loan, section 8.2.
Eigen::MatrixXd FindNullSpace(const BlockPattern& pattern, const double* S,
                              const Eigen::VectorXd& diagonal, double threshold, int most,
                              const Executor& executor);

}  // namespace inceres::internal
