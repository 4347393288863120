#pragma once

#include <vector>

#include <ceres/solver.h>

namespace inceres::internal {

/// The options for other linear solvers of stock's that solve the same problem, with the same numbers up to rounding (or, where
/// asked for an iterative one, as closely): none, one or two. `solved` is what stock says of the solve with the caller's options.
std::vector<ceres::Solver::Options> OtherLinearSolvers(const ceres::Solver::Options& quiet, const ceres::Solver::Summary& solved);

}  // namespace inceres::internal
