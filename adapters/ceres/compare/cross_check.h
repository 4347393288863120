#pragma once

#include <functional>
#include <string>

#include <ceres/problem.h>
#include <ceres/solver.h>

#include "inceres/ceres/solve.h"

namespace inceres::internal {

struct OurSolve {
  /// The solve that was asked for, stock's fallback included.
  std::function<void()> once;
  /// Solves once more, with these options and into this summary alone; null where a solve has lasting effects.
  std::function<void(const ceres::Solver::Options&, ceres::Solver::Summary*)> again;
};

/// Whether this call is to be solved by both, or written down.
inline bool WantsComparison(const SolveReport* report) {
  return report != nullptr && (report->cross_check.enabled || !report->ab_log.empty());
}

/// Solves with ours and, unless ours declines the problem, with stock, from the same start; compares, logs a disagreement, leaves
/// what is to be kept in `summary` and user memory, fills report->comparison, and appends to the A/B log. `obstacle`: why `ours`
/// is known to decline it, or empty. A strict refusal, where neither solves it, is not written to the log.
///
/// Stock gets a copy of the ordering and the options without callbacks and progress output; the rest, also
/// update_state_every_iteration, as given, for cost functions that read the caller's memory must see in it what they would.
/// The caller's callbacks are thus called as in one solve by ours. Ours goes first, but with a log the two take turns. What looks
/// like a violation is looked at again by SecondOpinion.
///
/// An exception out of user code passes through and leaves user memory as at the start.
void SolveAndCompare(const ceres::Solver::Options& options, ceres::Problem* problem, ceres::Solver::Summary* summary,
                     SolveReport* report, SolveMode mode, const OurSolve& ours, const std::string& obstacle = "");

}  // namespace inceres::internal
