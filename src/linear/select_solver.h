#pragma once

#include <memory>

#include "base/executor.h"
#include "inceres/linear/reduced_solver.h"
#include "linear/pcg_solver.h"

namespace inceres::internal {

/// Makes the solver of a batch solve's reduced system, already analyzed: the caller's own if he
/// gave a factory, otherwise dense or sparse Cholesky or conjugate gradients as asked, and under
/// kAutomatic the one with the lower predicted cost. *status gets the failure of the analysis, if
/// any. The executor serves the factorizations and outlives the solver.
std::unique_ptr<ReducedSolver> MakeReducedSolver(ReducedSolverKind kind,
                                                 const ReducedSolverFactory& factory,
                                                 const BlockPattern& pattern,
                                                 const Executor& executor, Status* status);

/// Makes that of an incremental solve, to be told of each pattern: the caller's own goes before
/// every kind, and may be null.
std::unique_ptr<ReducedSolver> MakeResumingSolver(ReducedSolverKind kind,
                                                  const ReducedSolverFactory& factory,
                                                  const PcgOptions& pcg, const Executor& executor);

}  // namespace inceres::internal
