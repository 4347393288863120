#pragma once

#include <memory>

#include "base/executor.h"
#include "linear/live_reduced_solver.h"
#include "linear/pcg_solver.h"

namespace inceres::internal {

/// Which solver takes the living reduced system.
enum class LiveReducedSolverKind {
  kAutomatic,  ///< AutomaticSolver: per factorisation the cheaper of resumed and sparse
  kResumed,    ///< ResumedSolver
  kDense,      ///< DenseCholesky
  kSparse,     ///< SparseCholesky
  kPcg,        ///< PcgSolver
};

/// The executor serves the dense factorisation and outlives the solver.
std::unique_ptr<LiveReducedSolver> MakeLiveReducedSolver(LiveReducedSolverKind kind, const PcgOptions& pcg,
                                                         const Executor& executor);

}  // namespace inceres::internal
