#pragma once

#include <ceres/solver.h>

#include "adapters/ceres/src/solve_input.h"
#include "inceres/ceres/solve.h"

namespace inceres::internal {

/// Solves with the core in exact mode: fixed cost, landmarks, graph, minimisation, write-back, summary. Writes user memory as
/// Ceres does: only blocks it moved, the best state if it is usable, else what was there before. `report` may be null.
void SolveExactly(const SolveInput& input, ceres::Solver::Summary* summary, SolveReport* report);

}  // namespace inceres::internal
