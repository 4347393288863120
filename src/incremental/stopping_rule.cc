#include "incremental/stopping_rule.h"

namespace inceres::internal {

bool StoppingRule::IsLittleLeft(double remaining, double landmark_gain, double cost, int iteration,
                                bool mostly_new) {
  return remaining + (landmark_creep_ - 1.0) * landmark_gain <= Allowed(cost) ||
         (!mostly_new && NextStepsGainLittle(remaining, landmark_gain, cost)) ||
         (HasStagnated(cost, iteration) && remaining <= Tolerance(cost));
}

// Steps tell how much their model undervalues: the last gained `last_gain_ratio_` times what it
// promised, and what is promised has fallen by a factor since. Steps like that go on to gain the
// sum of a geometric series. Landmarks that creep are counted more than once.
bool StoppingRule::NextStepsGainLittle(double remaining, double landmark_gain, double cost) const {
  if (!(last_remaining_ > 0.0)) {
    return false;
  }
  const double factor = remaining / last_remaining_;
  const double landmarks = std::max(tuning_.creeping_landmarks, landmark_creep_) * landmark_gain;
  return factor < tuning_.steady_factor &&
         std::max(1.0, last_gain_ratio_) * remaining / (1.0 - factor) + landmarks <=
             tuning_.rest_share * Tolerance(cost);
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
