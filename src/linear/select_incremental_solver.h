#pragma once

#include <memory>

#include "base/executor.h"
#include "inceres/linear/reduced_solver.h"
#include "linear/incremental_reduced_solver.h"
#include "linear/pcg_solver.h"

namespace inceres::internal {

/// One of the factory's, if there is one, goes before every kind. The executor serves the factorizations and outlives the solver.
std::unique_ptr<IncrementalReducedSolver> MakeIncrementalReducedSolver(ReducedSolverKind kind,
                                                                       const ReducedSolverFactory& factory, const PcgOptions& pcg,
                                                                       const Executor& executor);

}  // namespace inceres::internal
