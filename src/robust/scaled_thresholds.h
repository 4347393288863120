#pragma once

#include <vector>

#include "robust/graduation.h"
#include "robust/weighted_problem.h"

namespace inceres::internal {

/// What a chi-square threshold is to be multiplied by for measurements that came out better than
/// their information says: kTightTails times the largest ratio of a quantile of their squared
/// errors, of `degrees` residuals each, to that of the distribution, at 50, 75, 90 and 95 %. Not
/// above 1, and 1 where there are fewer than twenty. Errors of real measurements have longer tails
/// than their middle tells, which is why the quantiles go up to 95 %; a few wrong ones among them
/// do not reach any, and more of them, up to half, not the median, of whose ratio it is at most ten
/// times. Sorts the errors. Source: matching of quantiles (Huber & Ronchetti, "Robust Statistics",
/// 2009, section 5.1, has the median alone).
inline constexpr double kTightTails = 2.0;
double ThresholdScale(int degrees, std::vector<double>* squared_errors);

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
