// A step whose end cannot be evaluated, by Marquardt's rule: members of TrustRegionMinimizer.
#include <algorithm>
#include <limits>

#include "trust_region/trust_region_minimizer.h"

namespace inceres::internal {
namespace {

constexpr double kCut = 0.1;
constexpr int kMaxCuts = 8;
constexpr int kMaxHalvings = 4;
// Actual over predicted decrease, between which a step is in the right direction, and too long.
constexpr double kTooLong = 0.25;
constexpr double kMuchTooLong = -2.0;

}  // namespace

// The cost of the candidate that t of the step leads to; false if there is none.
bool TrustRegionMinimizer::EvaluateAlong(double t, double* cost) {
  scaled_step_.resize(step_.size());
  std::transform(step_.begin(), step_.end(), scaled_step_.begin(),
                 [t](double entry) { return t * entry; });
  return MoveCandidate(scaled_step_) && EvaluateCandidate(cost);
}

// The candidate is at t of the step: that is the step from now on.
void TrustRegionMinimizer::TakeShare(double t) {
  std::transform(step_.begin(), step_.end(), step_.begin(),
                 [t](double entry) { return t * entry; });
  model_decrease_ = model_.ModelDecrease(step_.data());
  clock_.Charge(&summary_.seconds.model_cost);
  iteration_.model_cost_change = model_decrease_;
  iteration_.step_share = t;
}

// Somewhere along the step a border lies beyond which a cost function refuses. The step is cut
// tenfold until it stays before it, and then goes up to it by halves, as long as the cost falls.
// More damping would cost a linear solve for each of these lengths. False: there is nothing to gain
// before the border.
bool TrustRegionMinimizer::CutStep(double* cost) {
  double beyond = 1.0;
  double t = kCut;
  for (int cuts = 1; !EvaluateAlong(t, cost); t *= kCut) {
    if (cuts++ == kMaxCuts) {
      return false;
    }
    beyond = t;
  }
  double last_tried = t;
  for (int k = 0; k < kMaxHalvings; ++k) {
    last_tried = 0.5 * (t + beyond);
    double there = 0.0;
    if (!EvaluateAlong(last_tried, &there)) {
      beyond = last_tried;
    } else if (there < *cost) {
      t = last_tried;
      *cost = there;
    } else {
      break;
    }
  }
  if (last_tried != t && !EvaluateAlong(t, cost)) {
    return false;
  }
  TakeShare(t);
  is_cut_ = true;
  return *cost < cost_ && model_decrease_ > 0.0;
}

// All lengths of this step have been tried: much more damping is to turn the next one.
void TrustRegionMinimizer::LeaveBorder() {
  strategy_->StepRejected();
  strategy_->StepRejected();
}

// Where the cost is more curved along the step than its model, which has first derivatives of the
// residuals alone, the minimum along it is nearer: at 1 / (2 - q) of the step, where q is actual
// over predicted decrease. More damping would shorten all other directions before this one.
void TrustRegionMinimizer::ShortenStep(double* cost) {
  const double quality = (cost_ - *cost) / model_decrease_;
  if (!(quality < kTooLong && quality > kMuchTooLong)) {
    return;
  }
  const double t = 1.0 / (2.0 - quality);
  double there = 0.0;
  if (EvaluateAlong(t, &there) && there < *cost) {
    *cost = there;
    TakeShare(t);
  } else if (!EvaluateAlong(1.0, cost)) {
    *cost = std::numeric_limits<double>::max();
  }
}

}  // namespace inceres::internal
