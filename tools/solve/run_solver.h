#pragma once

#include <vector>

#include "inceres/status.h"
#include "tools/command_line/progress.h"
#include "tools/problems/problem_source.h"
#include "tools/solve/solve_record.h"
#include "tools/solve/solver_flags.h"

namespace inceres::tools {

/// Who solves.
enum class Engine {
  kStock,  ///< ceres::Solve
  kShim,   ///< inceres::Solve on a ceres::Problem, in the mode of the settings
  kCore,   ///< inceres::Solve, or the IncrementalSolver, on a factor graph of built-in factors
};

/// How one solve is run.
struct RunPlan {
  Engine engine = Engine::kShim;
  SolverSettings settings;
  /// for the core, settings.linear_solver decides
  ceres::LinearSolverType linear_solver = ceres::DENSE_SCHUR;
  bool landmarks_first =
      false;            ///< hand Ceres the explicit elimination ordering; requires landmarks
  bool strict = false;  ///< the shim fails where it would use stock Ceres
  /// prints a line an iteration; may be null; incremental mode has nobody to call it
  ProgressTable* progress = nullptr;
};

/// What came of it.
struct RunOutcome {
  SolveRecord record;
  std::vector<double> parameters;  ///< laid out like ProblemSource::CeresInstance::parameters
};

/// Builds the problem anew and solves it. Only the Solve call is timed, its own set-up included. An
/// error means that the problem could not be built or the options do not go together; a solve that
/// fails is an outcome whose record is not usable.
Status Run(const RunPlan& plan, const ProblemSource& source, RunOutcome* outcome);

}  // namespace inceres::tools
