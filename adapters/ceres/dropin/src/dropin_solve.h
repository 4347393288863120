#pragma once

#include <ceres/problem.h>
#include <ceres/solver.h>

#include "adapters/ceres/dropin/src/registry.h"
#include "adapters/ceres/report/environment.h"

namespace inceres::internal {

/// Solves as the environment says: by inceres where it can, else by the next Ceres. Says once in
/// the log that it is at work. `known` is what was seen of the problem; null if its constructor was
/// not. Re-entrant; threads: any, on different Problems.
void SolveInsteadOfCeres(const Environment& environment, KnownProblem* known,
                         const ceres::Solver::Options& options, ceres::Problem* problem,
                         ceres::Solver::Summary* summary);

}  // namespace inceres::internal
