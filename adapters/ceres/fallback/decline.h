#pragma once

#include <string>

#include <ceres/problem.h>
#include <ceres/solver.h>

#include "inceres/ceres/solve.h"

namespace inceres::internal {

/// What the caller asks for stays, what happened is cleared. `report` may be null.
void ClearResults(SolveReport* report);

/// A problem we do not solve: stock Ceres does, unless the caller is strict. Requires that nothing of the user's has been called
/// or written so far. `report` may be null.
void Decline(const ceres::Solver::Options& options, ceres::Problem* problem, ceres::Solver::Summary* summary,
             const std::string& reason, SolveReport* report);

}  // namespace inceres::internal
