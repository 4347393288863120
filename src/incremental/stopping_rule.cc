#include "incremental/stopping_rule.h"

namespace inceres::internal {

// The tests of docs/algorithms.md, "Stopping rule", in its letters: R is `remaining`, G
// `landmark_gain`, L `landmark_rest`, T = Tolerance(cost), σ T = Allowed(cost), and the factor s of
// a claim is `series`. They only say that little is left; whether that is believed (trust
// rules) is the minimizer's business.

bool StoppingRule::IsLittleLeft(double remaining, double landmark_gain, double cost, int iteration,
                                bool mostly_new) {
  // From the test that needs no history to the one that needs most. An Update that is mostly new
  // has no steps yet that tell of the next, but it may stagnate.
  stagnated_gain_ = -1.0;
  const bool is_borne_out = IsBorneOut(remaining, cost);
  rests_on_nothing_ = !is_borne_out && remaining <= tuning_.nothing_share * Tolerance(cost);
  const double series = mostly_new ? 0.0 : SeriesOfSteps(remaining);
  bool is_small = IsSmall(remaining, 0.0, cost);
  bool falls = NextStepsGainLittle(series * remaining, 0.0, cost);
  waits_for_landmarks_ = false;
  if (is_small || falls) {
    const double landmark_rest = LandmarkRest(landmark_gain, cost);
    is_small = IsSmall(remaining, landmark_rest, cost);
    falls = NextStepsGainLittle(series * remaining, landmark_rest, cost);
    waits_for_landmarks_ = !is_small && !falls;
    landmarks_have_crept_ = landmarks_have_crept_ || sees_landmarks_creep();
    // Where they have crept far by themselves the frames go after them first.
    if (landmarks_have_crept_ && landmarks_gained_ > tuning_.rest_share * Tolerance(cost)) {
      is_small = falls = false;
    }
  }
  if (falls && is_borne_out) {
    // Remembered for the next Update, and forgotten with the next step.
    claim_ = {remaining, series};
  }
  claims_by_model_ = false;
  if (((is_small || falls) && is_borne_out) || (is_small && rests_on_nothing_) ||
      (!mostly_new && HasBeenClaimed(remaining, landmark_gain, cost))) {
    return true;
  }
  const bool stagnates = HasStagnated(cost, iteration) && remaining <= Tolerance(cost);
  stagnated_gain_ = stagnates ? checked_cost_ - cost : -1.0;
  claims_by_model_ = !stagnates && !waits_for_step_ && (is_small || falls);
  return stagnates || claims_by_model_;
}

// What landmarks could gain beyond what their model says: as much as their last pass has shown. Of
// those that were not asked it is a multiple of it, and nobody knows where they could gain much.
double StoppingRule::LandmarkRest(double landmark_gain, double cost) const {
  if (landmarks_left_ >= 0.0) {
    return landmarks_left_;
  }
  return landmark_gain > tuning_.landmarks_share * Tolerance(cost)
             ? HUGE_VAL
             : (tuning_.creeping_landmarks - 1.0) * landmark_gain;
}

bool StoppingRule::IsSmall(double remaining, double landmark_rest, double cost) const {
  return remaining <= Allowed(cost) &&
         remaining + landmark_rest <= tuning_.rest_share * Tolerance(cost);
}

// Steps tell how much their model undervalues: the last gained `last_gain_ratio_` times what it
// promised, and what is promised has fallen by a factor since. Steps like that go on to gain the
// sum of a geometric series, this times what is left. 0: it is not known, or falls too slowly.
double StoppingRule::SeriesOfSteps(double remaining) const {
  // Zero: no step was taken in this Update, or it was shortened and promised something else.
  if (!(last_remaining_ > 0.0)) {
    return 0.0;
  }
  const double factor = remaining / last_remaining_;
  return factor < tuning_.steady_factor ? std::max(1.0, last_gain_ratio_) / (1.0 - factor) : 0.0;
}

bool StoppingRule::NextStepsGainLittle(double series, double landmark_rest, double cost) const {
  return series > 0.0 && series + landmark_rest <= tuning_.rest_share * Tolerance(cost);
}

// What is left falls by φ = Σ r_i² R_i / Σ R_i, where the model's curvature in direction i is off
// by a share of r_i; so φ rises, toward the largest r_i², as far as steps are a linear iteration.
// A first step tells of the directions in which there was most to gain. Where another one is a
// saddle, r_i > 1, and little was left of it, that comes to light when φ jumps. Where φ was 1 or
// more a direction had just come up, and only its own steps tell how it falls.
bool StoppingRule::IsBorneOut(double remaining, double cost) const {
  if (std::isinf(tuning_.factor_growth) || !has_stepped_) {
    return std::isinf(tuning_.factor_growth) || !asks_for_step_;
  }
  const bool falls_steadily =
      !has_curved_down_ && previous_factor_ > 0.0 && previous_factor_ < 1.0 &&
      remaining < last_remaining_ &&
      remaining <= tuning_.factor_growth * previous_factor_ * last_remaining_;
  return last_gain_ratio_ <= kCurvesDown && last_gain_ratio_ >= kCurvesUp &&
         (falls_steadily || (last_gain_ <= tuning_.rest_share * Tolerance(cost) &&
                             !(last_remaining_ > 0.0 && remaining > last_remaining_)));
}

// Of the old rest it is known what steps make of it; what has come since is held against what may
// be left without a step.
bool StoppingRule::HasBeenClaimed(double remaining, double landmark_gain, double cost) const {
  // The part of R that was there before weighs as in the series' test, what is above it as in the
  // first one; together they may use up one allowance.
  const double old = std::min(remaining, claim_.remaining);
  return claim_.remaining > 0.0 && landmark_gain == 0.0 &&
         claim_.series * old / (tuning_.rest_share * Tolerance(cost)) +
                 (remaining - old) / Allowed(cost) <=
             1.0;
}

// Whether the last so many iterations have brought less than the tolerance together.
bool StoppingRule::HasStagnated(double cost, int iteration) {
  // Iterations since the last check; a check that fails begins the count anew.
  if (iteration < checked_iteration_ + tuning_.stagnation) {
    return false;
  }
  const bool stagnated = checked_cost_ - cost <= Tolerance(cost);
  if (!stagnated) {
    CountStepsFrom(iteration, cost);
  }
  return stagnated;
}

}  // namespace inceres::internal
