#pragma once

#include <vector>

#include <ceres/solver.h>

#include "adapters/ceres/plan/graph_plan.h"
#include "adapters/ceres/plan/landmark_selection.h"
#include "adapters/ceres/plan/solve_input.h"
#include "inceres/ceres/solve.h"

namespace inceres::internal {

/// The problem as a graph, by the input's plan. Of the view only the parameter blocks and totals
/// are kept. Returns where each block that the solver moves lies in the graph's state.
std::vector<StateBlock> TakeGraph(const SolveInput& input, ceres::LinearSolverType type,
                                  FactorGraph* graph, LandmarkCounts* landmarks,
                                  ceres::Solver::Summary* summary,
                                  const MakeFamily& make_family = nullptr);

/// Solves with the core in exact mode: fixed cost, landmarks, graph, minimization, write-back,
/// summary. Writes user memory as Ceres does: only blocks it moved, the best state if it is usable,
/// else what was there before.
void SolveExactly(const SolveInput& input, ceres::Solver::Summary* summary, SolveReport* report);

}  // namespace inceres::internal
