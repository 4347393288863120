#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <ceres/solver.h>

#include "inceres/solver/incremental_solver.h"
#include "inceres/solver/options.h"
#include "inceres/status.h"
#include "tools/solve/common_flags.h"

namespace inceres::tools {

/// What the flags shared by bal_solve and ab_compare say.
struct SolverSettings : CommonSettings {
  ceres::TrustRegionStrategyType trust_region = ceres::LEVENBERG_MARQUARDT;
  std::optional<ceres::LinearSolverType> linear_solver;  ///< empty: automatic
  bool lagged_pcg = false;  ///< the core's conjugate gradients with an earlier factor
  ceres::PreconditionerType preconditioner = ceres::SCHUR_JACOBI;  ///< of ITERATIVE_SCHUR
  /// with built-in factors or in incremental mode: kTwoLevel in its place
  bool two_level = false;
  bool single_precision = false;      ///< of the Jacobians that conjugate gradients multiply by
  bool recompute_jacobians = false;   ///< of a FactorGraph: none are kept
  std::int64_t max_memory_bytes = 0;  ///< that a solve may take; 0: what is left
  bool builtin_factors = false;
  bool incremental = false;       ///< ours solves in incremental mode
  bool inner_iterations = false;  ///< of a ceres::Problem; no flag reads it here
};

/// Reads --trust_region, --linear_solver, --preconditioner, --max_memory, --mode,
/// --builtin_factors and the common flags. A value that makes no sense, and a flag that nothing
/// reads, is kInvalidArgument; the message names the flag and what it may be.
Status ReadSolverFlags(SolverSettings* settings);

/// The linear solver the settings ask for; `automatic` where they leave it open.
ceres::LinearSolverType LinearSolverOr(const SolverSettings& settings,
                                       ceres::LinearSolverType automatic);

/// "dense_schur", "sparse_normal_cholesky", …: what --linear_solver reads.
std::string FlagName(ceres::LinearSolverType type);

/// The settings as options of Ceres (stock and shim), and of the core.
Status ToCeresOptions(const SolverSettings& settings, ceres::LinearSolverType type,
                      ceres::Solver::Options* options);
Status ToCoreOptions(const SolverSettings& settings, SolverOptions* options);

/// What --preconditioner two_level means in incremental mode.
ConjugateGradientsOptions TwoLevels(const SolverSettings& settings);

/// The settings as options of the IncrementalSolver; its damping starts at 1 /
/// --initial_trust_region_radius. It has one linear solver and refuses --linear_solver.
/// `without_effect` gets the other flags that were set and do nothing there.
Status ToIncrementalOptions(const SolverSettings& settings, IncrementalOptions* options,
                            std::vector<std::string>* without_effect);

}  // namespace inceres::tools
