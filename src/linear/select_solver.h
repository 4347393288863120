#pragma once

#include <memory>

#include "base/executor.h"
#include "inceres/linear/reduced_solver.h"

namespace inceres::internal {

/// Makes the solver of the reduced system, already analyzed: the caller's own if he gave a factory, otherwise dense or sparse
/// Cholesky or conjugate gradients as asked, and under kAutomatic the one with the lower predicted cost. Returns the analysis'
/// failure, if any, through *status.
std::unique_ptr<ReducedSolver> MakeReducedSolver(ReducedSolverKind kind, const ReducedSolverFactory& factory,
                                                 const BlockPattern& pattern, const Executor& executor, Status* status);

}  // namespace inceres::internal
