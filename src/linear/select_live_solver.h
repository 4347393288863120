#pragma once

#include <memory>

#include "base/executor.h"
#include "linear/live_reduced_solver.h"

namespace inceres::internal {

/// Which solver takes the living reduced system.
enum class LiveReducedSolverKind {
  kAutomatic,  ///< per factorisation the cheapest of resumed, dense and sparse by predicted flops
  kResumed,    ///< ResumedSolver
  kDense,      ///< DenseCholesky
  kSparse,     ///< SparseCholesky
};

/// The executor serves the dense factorisation and outlives the solver.
std::unique_ptr<LiveReducedSolver> MakeLiveReducedSolver(LiveReducedSolverKind kind, const Executor& executor);

}  // namespace inceres::internal
