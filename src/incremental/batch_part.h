#pragma once

#include <atomic>

#include "inceres/solver/solver.h"
#include "incremental/batch_observer.h"
#include "incremental/batch_phase.h"

namespace inceres::internal {

/// What the batch solver is asked for, but for the observer.
SolverOptions BatchOptions(const IncrementalOptions& options, const Tuning::Batch& tuning,
                           BatchEnd end);

/// One call of the batch solver: RunBatchPhase with a solver that may have served before, and with
/// what comes after it.
BatchOutcome RunPart(const IncrementalOptions& options, const Tuning::Batch& tuning, BatchEnd end,
                     const std::atomic<bool>& stop, Solver* solver, FactorGraph* graph,
                     const double** shown_state, UpdateTrace* trace);

}  // namespace inceres::internal
