#pragma once

#include "inceres/export.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/solver/incremental_options.h"
#include "inceres/solver/incremental_solver.h"
#include "inceres/solver/solver.h"
#include "inceres/solver/update_summary.h"

namespace inceres::internal {

/// The batch options that an IncrementalSolver with these options would hand a graph that is solved
/// once: landmarks that step by themselves, the curvature of robust losses, and a function
/// tolerance so small that the fall of the gains ends the solve first.
INCERES_EXPORT SolverOptions OneTimeOptions(const IncrementalOptions& options);

/// Minimizes a graph that nobody will remember as IncrementalSolver would, but by the batch solver
/// from beginning to end: nothing is set up for a next Update. It goes on until the gains have
/// fallen so far that all to come together are below a share of options.function_tolerance, or a
/// limit or the observer ends it. On a usable solution the graph's state is the best one found,
/// otherwise it is untouched, and the summary names what happened.
///
/// `solver` may have served graphs of the same structure before (Solver). `observer` may be null;
/// while it is called *best_state is the best state so far, laid out as FactorGraph::state(), and
/// null before and after. Bounds of the graph are kept as by the batch solver. Cost and threads:
/// those of inceres::Solve.
INCERES_EXPORT void SolveOnce(const IncrementalOptions& options, Solver* solver, FactorGraph* graph,
                              UpdateSummary* summary, UpdateObserver* observer = nullptr,
                              const double** best_state = nullptr);

}  // namespace inceres::internal
