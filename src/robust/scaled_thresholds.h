#pragma once

#include <vector>

#include "robust/graduation.h"
#include "robust/weighted_problem.h"

namespace inceres::internal {

/// Thresholds by what the errors of inliers are, where the information promises larger ones
/// (GncOptions::estimate_scale): tighter from one graduation to the next while that finds a smaller
/// scale, then a little looser, so that right suspects in the tails come back.
class ScaledThresholds {
 public:
  /// Both must outlive it; the thresholds are as the information has them.
  ScaledThresholds(WeightedProblem* problem, Graduation* graduation)
      : problem_(*problem), graduation_(*graduation), nominal_(problem->thresholds()) {}

  /// From a solution with thresholds by the information. Where the scale leaves out many more it
  /// was not that of the errors, as with few loops, whose errors say little: all is then as it was.
  /// False if a solve has failed.
  bool Solve();

 private:
  std::vector<double> ByErrors(const std::vector<double>& limits) const;
  bool Tighten();
  bool Relax();

  WeightedProblem& problem_;
  Graduation& graduation_;
  const std::vector<double> nominal_;
};

}  // namespace inceres::internal
