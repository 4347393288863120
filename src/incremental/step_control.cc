#include "incremental/step_control.h"

#include <algorithm>

namespace inceres::internal {

// μ and the radius (docs/algorithms.md, "Damping and trust region of incremental mode"). μ follows
// the gain ratio by the rule of Madsen, Nielsen & Tingleff 2004, with ν for refusals in a row,
// from one Update to the next. The radius is in the metric D² = diag H and exists only for a while
// after a refusal: it shortens steps for the price of an evaluation, where a change of μ costs a
// factorization. What refusals prove is remembered until a step is taken at the floor, for μ far
// above it hides what weak directions could gain.

StepControl::StepControl(const Tuning& tuning, const IncrementalOptions& options, double mu)
    : tuning_(tuning.retreat),
      stop_(tuning.stop),
      least_damping_(options.claim_damping_share * options.min_damping),
      max_damping_(options.max_damping),
      floor_(std::clamp(mu, least_damping_, options.min_damping)),
      mu_(std::clamp(mu, floor_, options.initial_damping)),
      refused_mu_(options.min_damping) {
}

// Between the two ratios the radius stays.
void StepControl::AdaptRadius(double gain_ratio, double norm) {
  if (IsGood(gain_ratio)) {
    radius_ = std::max(radius_, tuning_.radius_growth * norm);
  } else if (gain_ratio < tuning_.poor_ratio) {
    // Half the length of the step that did badly, not half the radius, which may be infinite.
    radius_ = tuning_.radius_fall * norm;
  }
}

// A step that was cut again and again without doing well asks for another direction, which damping
// gives; so the radius goes and μ grows, to be taken back in part by the line below.
void StepControl::Accept(double gain_ratio, double gain, bool shortened) {
  num_shortened_ = shortened ? num_shortened_ + 1 : 0;
  if (num_shortened_ >= tuning_.max_shortened_in_row && !IsGood(gain_ratio)) {
    radius_ = HUGE_VAL;
    mu_ *= tuning_.damping_growth;
    num_shortened_ = 0;
  }
  // μ max(1/3, 1 − (2ϱ − 1)³): falls for ϱ > ½, at most to a third, and grows below.
  mu_ = std::max(floor_, mu_ * std::max(1.0 / 3.0, 1.0 - std::pow(2.0 * gain_ratio - 1.0, 3)));
  nu_ = 2.0;
  lowered_ = false;
  gained_since_floor_ += gain;
  // Evidence from refusals is void once a step was taken at the floor.
  const bool hard = IsDampedHard();
  relaxed_ = relaxed_ && hard;
  refused_blindly_ = refused_blindly_ && hard;
  remaining_when_refused_ = hard ? remaining_when_refused_ : HUGE_VAL;
}

bool StepControl::Refuse(double remaining, bool blindly) {
  refused_mu_ = mu_;
  remaining_when_refused_ = remaining;
  refused_blindly_ |= blindly;
  // Tenfold times ν: from a floor of tiny damping doubling would refuse many steps before one is
  // turned.
  mu_ *= tuning_.damping_growth * nu_;
  nu_ *= 2.0;
  return mu_ <= max_damping_;
}

// What was seen at the floor, and refused there, was of another point once so much has been gained.
bool StepControl::RelaxOnce(double tolerance) {
  if (!IsDampedHard() || (relaxed_ && gained_since_floor_ <= tolerance)) {
    return false;
  }
  relaxed_ = true;
  // ν too: refusals before are not to make the first one at the floor count double.
  mu_ = floor_;
  nu_ = 2.0;
  return true;
}

// Along a direction with a gradient g, in which S is as stiff as s, the step is δ = g / (s + μ):
// where s is small beside μ, g is μδ, and ½ (μδ)² / s what is hidden, of which ½ g² / μ is seen.
bool StepControl::MayHide(double remaining, double little) const {
  const double hidden = 0.5 * std::min(damped_square_, 2.0 * mu_ * remaining) / least_damping_;
  return !lowered_ && mu_ > least_damping_ && hidden > little;
}

bool StepControl::LowerOnce(double remaining, double little) {
  if (!MayHide(remaining, little)) {
    return false;
  }
  lowered_ = true;
  mu_ = floor_ = least_damping_;
  nu_ = 2.0;
  return true;
}

StepControl::Verdict StepControl::JudgeRefusals(double tolerance) {
  // No statement about a place that could not be evaluated.
  if (refused_blindly_) {
    return Verdict::kUnknown;
  }
  // Near the floor the model saw little: what is refused with more damping is below the tolerance.
  if (remaining_at_floor_ <= tolerance) {
    return Verdict::kMinimum;
  }
  // No damping between the last two is left to try, or at the last one nothing was to be had.
  if (remaining_when_refused_ <= tolerance || mu_ <= stop_.fine_damping * refused_mu_) {
    return Verdict::kRefusals;
  }
  // Halfway in the logarithm, for what lies between has not been tried.
  mu_ = std::sqrt(mu_ * refused_mu_);
  return Verdict::kTryBetween;
}

}  // namespace inceres::internal
