#pragma once

#include <limits>
#include <string>
#include <vector>

#include <ceres/solver.h>

#include "adapters/ceres/read/user_state.h"
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

JudgedTolerances TolerancesFor(const SolveOptions& asked, const ceres::Solver::Options& options);

/// The values of a UserState before the solves and after each.
struct SolvedStates {
  std::vector<double> start;
  std::vector<double> ours;
  std::vector<double> stock;
};

/// By how much solves of stock Ceres, from one start, with different linear solvers, differ from
/// each other; the largest where there are several. Multiplied already: a difference of ours up to
/// this much is excused.
struct Excuse {
  /// from here on no trace is judged, nor how long it is
  int first_different_iteration = std::numeric_limits<int>::max();
  std::vector<double> costs;  ///< up to each iteration before that one
  std::vector<double> radii;
  double final_cost = 0.0;
  double parameters = 0.0;
  double iterations = 0.0;
  bool terminations = false;  ///< they end in different ways
};

/// Judges result->ours against result->stock: fills cost_difference, parameters,
/// first_different_iteration, violations, and in `reason` what was not judged because a clock or a
/// callback ended a solve.
void Compare(const UserState& layout, const SolvedStates& states,
             const JudgedTolerances& tolerances, const Excuse& excuse, CrossCheckResult* result);

/// Adds to the excuse what the two solves of `pair`, both stock's, differ by, times `factor`.
/// `pair` has been compared without an excuse.
void Widen(const CrossCheckResult& pair, double factor, Excuse* excuse);

/// What the log says of a cross-check that found violations: each of them, the first iteration that
/// differs, the parameter that differs most, and both traces side by side around that iteration.
std::string DescribeDisagreement(const CrossCheckResult& result);

/// What the log says of one that found differences beyond the tolerances, but excused them.
std::string DescribeExcuse(const CrossCheckResult& result);

}  // namespace inceres::internal
