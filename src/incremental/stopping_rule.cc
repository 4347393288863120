#include "incremental/stopping_rule.h"

namespace inceres::internal {

bool StoppingRule::IsLittleLeft(double remaining, double landmark_gain, double cost, int iteration,
                                bool mostly_new) {
  return remaining + (landmark_creep_ - 1.0) * landmark_gain <= Allowed(cost) ||
         (!mostly_new && (NextStepsGainLittle(remaining, landmark_gain, cost) ||
                          HasBeenClaimed(remaining, landmark_gain, cost))) ||
         (HasStagnated(cost, iteration) && remaining <= Tolerance(cost));
}

// Steps tell how much their model undervalues: the last gained `last_gain_ratio_` times what it
// promised, and what is promised has fallen by a factor since. Steps like that go on to gain the
// sum of a geometric series. Landmarks that creep are counted more than once.
bool StoppingRule::NextStepsGainLittle(double remaining, double landmark_gain, double cost) {
  if (!(last_remaining_ > 0.0)) {
    return false;
  }
  const double factor = remaining / last_remaining_;
  const double landmarks = std::max(tuning_.creeping_landmarks, landmark_creep_) * landmark_gain;
  const double series = std::max(1.0, last_gain_ratio_) / (1.0 - factor);
  const bool little = factor < tuning_.steady_factor &&
                      series * remaining + landmarks <= tuning_.rest_share * Tolerance(cost);
  if (little) {
    claim_ = {remaining, series};
  }
  return little;
}

// Of the old rest it is known what steps make of it; what has come since is held against what may
// be left without a step.
bool StoppingRule::HasBeenClaimed(double remaining, double landmark_gain, double cost) const {
  const double old = std::min(remaining, claim_.remaining);
  return claim_.remaining > 0.0 && landmark_gain == 0.0 &&
         claim_.series * old / (tuning_.rest_share * Tolerance(cost)) +
                 (remaining - old) / Allowed(cost) <=
             1.0;
}

// Whether the last so many iterations have brought less than the tolerance together.
bool StoppingRule::HasStagnated(double cost, int iteration) {
  if (iteration < checked_iteration_ + tuning_.stagnation) {
    return false;
  }
  const bool stagnated = checked_cost_ - cost <= Tolerance(cost);
  if (!stagnated) {
    checked_iteration_ = iteration;
    checked_cost_ = cost;
  }
  return stagnated;
}

}  // namespace inceres::internal
