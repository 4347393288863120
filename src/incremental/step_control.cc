#include "incremental/step_control.h"

#include <algorithm>

namespace inceres::internal {

StepControl::StepControl(const Tuning& tuning, const IncrementalOptions& options, double mu)
    : tuning_(tuning.retreat),
      stop_(tuning.stop),
      min_damping_(options.min_damping),
      max_damping_(options.max_damping),
      mu_(std::clamp(mu, options.min_damping, options.initial_damping)),
      refused_mu_(options.min_damping) {
}

void StepControl::AdaptRadius(double gain_ratio, double norm) {
  if (IsGood(gain_ratio)) {
    radius_ = std::max(radius_, tuning_.radius_growth * norm);
  } else if (gain_ratio < tuning_.poor_ratio) {
    radius_ = tuning_.radius_fall * norm;
  }
}

void StepControl::Accept(double gain_ratio, bool shortened) {
  num_shortened_ = shortened ? num_shortened_ + 1 : 0;
  if (num_shortened_ >= tuning_.max_shortened_in_row && !IsGood(gain_ratio)) {
    radius_ = HUGE_VAL;
    mu_ *= tuning_.damping_growth;
    num_shortened_ = 0;
  }
  mu_ =
      std::max(min_damping_, mu_ * std::max(1.0 / 3.0, 1.0 - std::pow(2.0 * gain_ratio - 1.0, 3)));
  nu_ = 2.0;
  const bool hard = IsDampedHard();
  relaxed_ = relaxed_ && hard;
  refused_blindly_ = refused_blindly_ && hard;
  remaining_when_refused_ = hard ? remaining_when_refused_ : HUGE_VAL;
}

bool StepControl::Refuse(double remaining, bool blindly) {
  refused_mu_ = mu_;
  remaining_when_refused_ = remaining;
  refused_blindly_ |= blindly;
  mu_ *= tuning_.damping_growth * nu_;
  nu_ *= 2.0;
  return mu_ <= max_damping_;
}

bool StepControl::RelaxOnce() {
  if (!IsDampedHard() || relaxed_) {
    return false;
  }
  relaxed_ = true;
  mu_ = min_damping_;
  nu_ = 2.0;
  return true;
}

StepControl::Verdict StepControl::JudgeRefusals(double tolerance) {
  if (refused_blindly_) {
    return Verdict::kUnknown;
  }
  if (remaining_at_floor_ <= tolerance) {
    return Verdict::kMinimum;
  }
  if (remaining_when_refused_ <= tolerance || mu_ <= stop_.fine_damping * refused_mu_) {
    return Verdict::kRefusals;
  }
  mu_ = std::sqrt(mu_ * refused_mu_);
  return Verdict::kTryBetween;
}

}  // namespace inceres::internal
