#pragma once

#include <vector>

#include <ceres/solver.h>

#include "adapters/ceres/src/user_state.h"
#include "inceres/ceres/cross_check.h"
#include "inceres/ceres/solve.h"

namespace inceres::internal {

/// What is judged, every default filled in. Infinity: not judged.
struct JudgedTolerances {
  double cost = 0.0;
  double lower_cost = 0.0;  ///< the same where ours is the lower one
  double parameters = 0.0;
  double iterations = 0.0;
  double radius = 0.0;
  double function_tolerance = 0.0;  ///< what one more iteration may gain
  double max_seconds = 0.0;         ///< a solve that took as long was ended by the clock
  bool traces = true;               ///< iterations are comparable one by one
};

JudgedTolerances TolerancesFor(SolveMode mode, const CrossCheckOptions& check, const ceres::Solver::Options& options);

/// The values of a UserState before the solves and after each.
struct SolvedStates {
  std::vector<double> start;
  std::vector<double> ours;
  std::vector<double> stock;
};

/// Judges result->ours against result->stock: fills cost_difference, parameters, first_different_iteration, violations, and in
/// `reason` what was not judged because a clock or a callback ended a solve.
void Compare(const UserState& layout, const SolvedStates& states, const JudgedTolerances& tolerances, CrossCheckResult* result);

}  // namespace inceres::internal
