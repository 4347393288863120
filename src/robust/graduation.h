#pragma once

#include <cstddef>
#include <vector>

#include "inceres/solver/gnc.h"
#include "robust/gnc_schedule.h"
#include "robust/weighted_problem.h"

namespace inceres::internal {

/// Graduated non-convexity on a weighted problem with given thresholds (docs/algorithms.md,
/// "Graduated non-convexity"): from the convex cost to the robust one, until its weights agree with
/// what they lead to, and then a second look at what was left out.
class Graduation {
 public:
  /// Both must outlive it.
  Graduation(const GncOptions& options, WeightedProblem* problem)
      : options_(options), problem_(*problem), schedule_(options.kernel, options.step) {}

  /// From full weights on: what a wrong suspect has bent that was taken for right holds it. False
  /// if a solve has failed.
  bool SolveToTheEnd();
  /// The last cost itself, by its weights, from where the problem stands. False likewise.
  bool Settle();
  /// Tries suspects that were left out with errors up to so many thresholds as inliers, if the
  /// kernel tells them from others at all.
  void LookAgain(double farthest);
  /// The thresholds are other ones: as many rounds as the options allow begin now.
  void BeginRounds() { rounds_before_ = problem_.summary().rounds.size(); }
  bool HasBegunAnew() const { return rounds_before_ > 0; }

 private:
  bool HasRoundsLeft(std::size_t count) const {
    return problem_.summary().rounds.size() + count <=
           rounds_before_ + static_cast<std::size_t>(options_.max_rounds);
  }
  bool Graduate();
  std::vector<double> WeightsNow(bool last) const;
  bool SolveWeighted(bool last) { return problem_.Solve(last, schedule_.mu()); }
  bool TryWith(double limit);

  const GncOptions& options_;
  WeightedProblem& problem_;
  GncSchedule schedule_;
  std::size_t rounds_before_ = 0;  // the thresholds were set
};

}  // namespace inceres::internal
