#pragma once

#include <memory>

#include "base/executor.h"
#include "inceres/linear/reduced_solver.h"
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

/// One of the factory's, if there is one, goes before every kind. The executor serves the factorisations and outlives the solver.
std::unique_ptr<LiveReducedSolver> MakeLiveReducedSolver(LiveReducedSolverKind kind, const ReducedSolverFactory& factory,
                                                         const PcgOptions& pcg, const Executor& executor);

}  // namespace inceres::internal
