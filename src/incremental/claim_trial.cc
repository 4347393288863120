#include "incremental/claim_trial.h"

#include <cmath>

namespace inceres::internal {

void ClaimTrial::StepTaken(double promise, double gain_ratio) {
  const bool kept = std::fabs(gain_ratio - 1.0) <= 1.0 - tuning_.trial_fall;
  promise_ = kept ? promise : 0.0;
}

bool ClaimTrial::Holds(double remaining, double tolerance) {
  // Larger steps are about other things than what is left.
  if (num_steps_ == 0 || promise_ > tolerance) {
    begun_at_ = remaining;
    num_steps_ = num_falls_ = 0;
  } else {
    num_falls_ = remaining <= tuning_.trial_fall * promise_ ? num_falls_ + 1 : 0;
  }
  // A step of the trial that did not keep its promise says that the model is wrong here.
  const bool refuted = num_steps_ > 0 && promise_ == 0.0;
  const bool nothing = !refuted && remaining <= tuning_.nothing_share * tolerance;
  const bool rests = num_steps_ >= tuning_.trial_steps && remaining <= begun_at_;
  if (!needed_ || nothing || rests || num_falls_ >= tuning_.trial_falls ||
      num_steps_ >= tuning_.stagnation) {
    return true;
  }
  ++num_steps_;
  return false;
}

}  // namespace inceres::internal
