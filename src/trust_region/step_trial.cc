#include "trust_region/step_trial.h"

#include <algorithm>
#include <optional>

namespace inceres::internal {
namespace {

// What follows a valid step: move, evaluate, and by Marquardt's rule find a length that can be
// evaluated and that the cost agrees with (docs/algorithms.md, "One-time solves and exact
// windows"). The promise is always that of the step as it is judged: a share has its own, and what
// a refinement gains is added.

// How a step is cut whose end cannot be evaluated.
constexpr double kCut = 0.1;
constexpr int kMaxCuts = 8;
constexpr int kMaxHalvings = 4;

// Actual over predicted decrease, between which a step is in the right direction, and too long.
constexpr double kTooLong = 0.25;
constexpr double kMuchTooLong = -2.0;

}  // namespace

StepTrial::StepTrial(const SolverOptions& options, const LoopOptions& loop,
                     LoopEvaluation* evaluation, LinearModel* model, std::vector<double>* step,
                     std::vector<double>* scaled_step, Summary* summary)
    : options_(options),
      evaluation_(*evaluation),
      model_(*model),
      step_(*step),
      scaled_step_(*scaled_step),
      summary_(*summary),
      refinement_(options, loop, evaluation, summary) {
}

// A pass over J; also for a share, where promise and length are not proportional.
double StepTrial::FindPromise() {
  promise_ = model_.ModelDecrease(step_.data());
  evaluation_.clock().Charge(&summary_.seconds.model_cost);
  return promise_;
}

void StepTrial::Run(double cost, IterationSummary* iteration) {
  Follow(cost, iteration);
  descent_was_useful_ = false;
  if (refinement_.Descends() && HasEnd()) {
    Descend(cost, iteration);
  }
  if (is_cut_ || EndsBeyondBorder()) {
    NoteRefusal();
  } else if (!holds_ && iteration->step_share >= 1.0) {
    refusing_.Clear();
  }
}

const std::vector<char>& StepTrial::Hold(bool holds) {
  holds_ = holds;
  return holds ? refusing_.flags() : no_flags_;
}

void StepTrial::Follow(double start_cost, IterationSummary* iteration) {
  // No end until one was evaluated.
  cost_ = std::numeric_limits<double>::max();
  is_cut_ = false;
  double cost = 0.0;
  const bool moved = evaluation_.MoveCandidate(step_);
  // Only the first failure of the solve is told.
  if (!moved && summary_.failed_step.empty()) {
    summary_.failed_step = "x_plus_delta = Plus(x, delta) failed";
  }
  bool evaluated = moved && evaluation_.CandidateCost(&cost);
  // Other strategies take a step as it is.
  if (IsByMarquardt() && evaluated) {
    Shorten(start_cost, &cost, iteration);
  } else if (IsByMarquardt()) {
    evaluated = Cut(start_cost, &cost, iteration);
  }
  if (!evaluated) {
    return;
  }
  cost_ = cost;
  // Gains come as differences of the landmarks' own factors; the loop sums the cost anew if the
  // step is taken.
  if (const double gain = refinement_.RefineLandmarks(start_cost, cost); gain > 0.0) {
    cost_ -= gain;
    promise_ += gain;
    iteration->model_cost_change = promise_;
  }
}

void StepTrial::Descend(double start_cost, IterationSummary* iteration) {
  const std::optional<double> cost = refinement_.Descend(cost_);
  if (!cost.has_value()) {
    return;
  }
  // What was gained counts as promised, so that the ratio judges the step.
  promise_ += cost_ - *cost;
  iteration->model_cost_change = promise_;
  descent_was_useful_ = *cost < start_cost;
  cost_ = *cost;
}

// The cost of the candidate that t of the step leads to; false if there is none.
bool StepTrial::EvaluateAlong(double t, double* cost) {
  scaled_step_.resize(step_.size());
  std::transform(step_.begin(), step_.end(), scaled_step_.begin(),
                 [t](double entry) { return t * entry; });
  return evaluation_.MoveCandidate(scaled_step_) && evaluation_.CandidateCost(cost);
}

// The candidate is at t of the step: that is the step from now on.
void StepTrial::TakeShare(double t, IterationSummary* iteration) {
  std::transform(step_.begin(), step_.end(), step_.begin(),
                 [t](double entry) { return t * entry; });
  iteration->model_cost_change = FindPromise();
  iteration->step_share = t;
}

// Somewhere along the step a border lies beyond which a cost function refuses. The step is cut
// tenfold until it stays before it, and then goes up to it by halves, as long as the cost falls.
// False: there is nothing to gain before the border.
bool StepTrial::Cut(double start_cost, double* cost, IterationSummary* iteration) {
  double beyond = 1.0;
  double t = kCut;
  // beyond: the shortest share that is known to lie behind the border.
  for (int cuts = 1; !EvaluateAlong(t, cost); t *= kCut) {
    if (cuts++ == kMaxCuts) {
      return false;
    }
    beyond = t;
  }
  double last_tried = t;
  t = GoUpToBorder(t, beyond, cost, &last_tried);
  // The last trial lay elsewhere: the candidate goes back to t.
  if (last_tried != t && !EvaluateAlong(t, cost)) {
    return false;
  }
  TakeShare(t, iteration);
  is_cut_ = true;
  // A step that leads uphill up to the border is refused as a whole.
  return *cost < start_cost && promise_ > 0.0;
}

// The share to take, between t, of this cost, and what lies beyond the border.
double StepTrial::GoUpToBorder(double t, double beyond, double* cost, double* last_tried) {
  for (int k = 0; k < kMaxHalvings; ++k) {
    *last_tried = 0.5 * (t + beyond);
    double there = 0.0;
    if (!EvaluateAlong(*last_tried, &there)) {
      beyond = *last_tried;
    } else if (there < *cost) {
      t = *last_tried;
      *cost = there;
    } else {
      // Farther up the cost rises again: the border is not what limits this step.
      break;
    }
  }
  return t;
}

// Where the cost is more curved along the step than its model, which has first derivatives of the
// residuals alone, the minimum along it is nearer: at 1 / (2 - q) of the step, where q is actual
// over predicted decrease. More damping would shorten all other directions before this one.
void StepTrial::Shorten(double start_cost, double* cost, IterationSummary* iteration) {
  const double quality = (start_cost - *cost) / promise_;
  // Negated, so that NaN is left alone. Above, the model is good enough; below, another direction
  // is needed.
  if (!(quality < kTooLong && quality > kMuchTooLong)) {
    return;
  }
  const double t = 1.0 / (2.0 - quality);
  double there = 0.0;
  if (EvaluateAlong(t, &there) && there < *cost) {
    *cost = there;
    TakeShare(t, iteration);
  } else if (!EvaluateAlong(1.0, cost)) {
    // The candidate goes back to the end of the step, which was evaluated before.
    *cost = std::numeric_limits<double>::max();
  }
}

}  // namespace inceres::internal
