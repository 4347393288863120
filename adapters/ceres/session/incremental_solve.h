#pragma once

#include <ceres/solver.h>

#include "adapters/ceres/plan/solve_input.h"
#include "adapters/ceres/session/incremental_problem.h"
#include "inceres/ceres/session.h"
#include "inceres/ceres/solve.h"

namespace inceres::internal {

/// Brings `living` to where the problem is, minimizes, writes back what it moved if the result is
/// usable, and fills the summary. A null `living` stands for a problem of which nothing is
/// remembered: the batch solver's from beginning to end, by a plan and a solver from the cache.
/// False after a failure or a callback's abort: user memory is as it was, and `living` is of no
/// more use. `core` are the options mapped.
bool SolveIncrementally(const SolveInput& input, const IncrementalOptions& core,
                        IncrementalProblem* living, ceres::Solver::Summary* summary,
                        SolveReport* report);

/// Brings `living`, which is new, to where the problem is, and linearizes it there: the next solve
/// goes on from it. No value moves. False if that could not be evaluated, or time is up.
bool LinearizeOnly(const SolveInput& input, const IncrementalOptions& core,
                   IncrementalProblem* living);

}  // namespace inceres::internal
