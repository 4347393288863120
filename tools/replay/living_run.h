#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "inceres/status.h"
#include "tools/problems/problem_source.h"
#include "tools/replay/replay_ceres_solve.h"
#include "tools/replay/replay_solver.h"
#include "tools/replay/replay_step.h"

namespace inceres::tools {

/// How a user's program keeps a problem that grows.
enum class LivingMode {
  kPlain,  ///< one ceres::Problem, to which each step adds
  /// a new one for every step, with new cost functions over the same parameter arrays, as VINS does
  kRebuild,
};

/// Told after each solve: how many are done, of how many.
using OnLivingSolve = std::function<void(std::size_t solve, std::size_t num_solves)>;

/// What a run did, solve by solve.
struct LivingReport {
  std::vector<ReplayOutcome> solves;
  double total_seconds = 0.0;  ///< of the run: adding, solving, and destroying problems
};

/// Plays up to `max_steps` steps (0: all) of a script with edits of a ceres::Problem and one call
/// of `solve` after each, and nothing else: what runs here is what a program runs that knows Ceres
/// only. A solve that fails is in the report and ends nothing; an error is a step that cannot be
/// added. `on_solve` may be null; after each solve it is told how many are done, of how many.
Status PlayLiving(const ReplayScript& script, int max_steps, const ReplaySettings& settings,
                  LivingMode mode, const CeresSolveFunction& solve, LivingReport* report,
                  const OnLivingSolve& on_solve = nullptr);

/// Adds up to `max_steps` steps (0: all), then solves once.
Status PlayAtOnce(const ReplayScript& script, int max_steps, const ReplaySettings& settings,
                  const CeresSolveFunction& solve, LivingReport* report);

/// One solve of a problem from a file, from the values that it has there.
Status PlayAtOnce(const ProblemSource& source, const LossSpec& loss, const ReplaySettings& settings,
                  const CeresSolveFunction& solve, LivingReport* report);

/// Solves one by one, milliseconds of the solve calls (median, p95, max, total), seconds in all,
/// the last cost and the sum of all final costs. Requires a solve.
nlohmann::json ToJson(const LivingReport& report);

}  // namespace inceres::tools
