#pragma once

#include <optional>
#include <string>

#include <ceres/solver.h>

#include "inceres/solver/options.h"
#include "inceres/status.h"
#include "tools/common/loss_spec.h"

namespace inceres::tools {

/// What the flags shared by bal_solve and ab_compare say.
struct SolverSettings {
  ceres::TrustRegionStrategyType trust_region = ceres::LEVENBERG_MARQUARDT;
  std::optional<ceres::LinearSolverType> linear_solver;  ///< empty: automatic
  int num_threads = 1;
  int max_num_iterations = 50;
  double function_tolerance = 1e-6;
  double gradient_tolerance = 1e-10;
  double parameter_tolerance = 1e-8;
  LossSpec robust;
  bool builtin_factors = false;
};

/// Reads --trust_region, --linear_solver, --num_threads, --max_num_iterations, --function_tolerance, --gradient_tolerance,
/// --parameter_tolerance, --robust, --mode and --builtin_factors. A value that makes no sense is kInvalidArgument, a mode that
/// does not exist yet kUnavailable; the message names the flag and what it may be.
Status ReadSolverFlags(SolverSettings* settings);

/// The linear solver the settings ask for; `automatic` where they leave it open.
ceres::LinearSolverType LinearSolverOr(const SolverSettings& settings, ceres::LinearSolverType automatic);

/// "dense_schur", "sparse_normal_cholesky", …: what --linear_solver reads.
std::string FlagName(ceres::LinearSolverType type);

/// The settings as options of Ceres (stock and shim), and of the core. The core refuses iterative linear solvers.
Status ToCeresOptions(const SolverSettings& settings, ceres::LinearSolverType type, ceres::Solver::Options* options);
Status ToCoreOptions(const SolverSettings& settings, SolverOptions* options);

}  // namespace inceres::tools
