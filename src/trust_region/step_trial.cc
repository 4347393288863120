#include "trust_region/step_trial.h"

#include <algorithm>
#include <cstddef>

namespace inceres::internal {
namespace {

// What follows a valid step: move, evaluate, and by Marquardt's rule find a length that can be
// evaluated and that the cost agrees with (docs/algorithms.md, "One-time solves and exact
// windows"). The promise is always that of the step as it is judged: a share has its own, and what
// a refinement gains is added, so that the gain ratio judges the step's model and not the
// refinement. The two refinements are independent: refine_landmarks is ours, the rounds come with
// Ceres's use_inner_iterations.

// How a step is cut whose end cannot be evaluated.
constexpr double kCut = 0.1;
constexpr int kMaxCuts = 8;
constexpr int kMaxHalvings = 4;

// Actual over predicted decrease, between which a step is in the right direction, and too long.
constexpr double kTooLong = 0.25;
constexpr double kMuchTooLong = -2.0;

// A landmark moves by itself if it gains more than this share of what the function tolerance allows
// all of them together.
constexpr double kInnerShare = 0.01;

}  // namespace

StepTrial::StepTrial(const LoopParts& parts, LoopEvaluation* evaluation)
    : parts_(parts),
      evaluation_(*evaluation),
      step_(parts.memory.step),
      scaled_step_(parts.memory.scaled_step) {
  const LoopOptions& loop = parts.loop;
  if (parts.options.refine_landmarks && parts.evaluator.layout().num_landmarks() > 0) {
    inner_iterations_ = std::make_unique<InnerIterations>(&parts.evaluator);
    parts.summary.work.bytes += inner_iterations_->Bytes();
  }
  if (loop.inner_descent != nullptr) {
    coordinate_descent_ =
        std::make_unique<CoordinateDescent>(*loop.inner_descent, loop.rules, &parts.evaluator);
  }
}

// A pass over J; also for a share, where promise and length are not proportional.
double StepTrial::FindPromise() {
  promise_ = parts_.model.ModelDecrease(step_.data());
  parts_.clock.Charge(&parts_.summary.seconds.model_cost);
  return promise_;
}

void StepTrial::Run(double cost, IterationSummary* iteration) {
  Follow(cost, iteration);
  descent_was_useful_ = false;
  if (coordinate_descent_ != nullptr && HasEnd()) {
    Descend(cost, iteration);
  }
  if (is_cut_ || EndsBeyondBorder()) {
    NoteRefusal();
  } else if (!holds_ && iteration->step_share >= 1.0) {
    refusing_.clear();
  }
}

const std::vector<char>& StepTrial::Hold(bool holds) {
  holds_ = holds;
  return holds ? refusing_ : no_flags_;
}

void StepTrial::NoteRefusal() {
  const Evaluator& evaluator = parts_.evaluator;
  const FactorId factor = evaluator.failed_factor();
  if (factor.index < 0) {
    return;
  }
  const Layout& layout = evaluator.layout();
  refusing_.resize(static_cast<std::size_t>(layout.size()), 0);
  const FactorGraph& graph = evaluator.graph();
  for (int s = 0; s < graph.family(factor.family).num_slots(); ++s) {
    const int at = layout.Position(graph.Variables(factor.family, factor.index)[s]);
    for (int k = at < 0 ? 0 : layout.packed_offset[at]; at >= 0 && k < layout.packed_offset[at + 1];
         ++k) {
      refusing_[static_cast<std::size_t>(k)] = 1;
    }
  }
}

void StepTrial::Follow(double start_cost, IterationSummary* iteration) {
  // No end until one was evaluated.
  cost_ = std::numeric_limits<double>::max();
  is_cut_ = false;
  double cost = 0.0;
  const bool moved = evaluation_.MoveCandidate(step_);
  // Only the first failure of the solve is told.
  if (!moved && parts_.summary.failed_step.empty()) {
    parts_.summary.failed_step = "x_plus_delta = Plus(x, delta) failed";
  }
  bool evaluated = moved && evaluation_.CandidateCost(&cost);
  // Other strategies take a step as it is.
  if (IsByMarquardt() && evaluated) {
    Shorten(start_cost, &cost, iteration);
  } else if (IsByMarquardt()) {
    evaluated = Cut(start_cost, &cost, iteration);
  }
  if (evaluated) {
    cost_ = cost;
    RefineLandmarks(start_cost, iteration);
  }
}

// Landmarks move by themselves, where that is worth it: steps that do not creep need no help
// (InnerIterations::IsDue).
void StepTrial::RefineLandmarks(double start_cost, IterationSummary* iteration) {
  const double step_gain = start_cost - cost_;
  if (inner_iterations_ == nullptr || !inner_iterations_->IsDue(step_gain)) {
    return;
  }
  // The function tolerance of what can change of the cost, a share of it for each landmark.
  const double min_gain = kInnerShare * parts_.options.function_tolerance *
                          (start_cost - parts_.loop.fixed_cost) /
                          parts_.evaluator.layout().num_landmarks();
  const double gain = inner_iterations_->Run(min_gain, step_gain);
  parts_.summary.work.num_refined_landmarks += inner_iterations_->num_moved();
  // What this round has gained decides how long the next one waits.
  inner_iterations_->Pace(gain, step_gain);
  // Gains come as differences of the landmarks' own factors; the loop sums the cost anew if the
  // step is taken.
  if (gain > 0.0) {
    cost_ -= gain;
    promise_ += gain;
    iteration->model_cost_change = promise_;
  }
}

// A round of coordinate descent from the end of the step.
void StepTrial::Descend(double start_cost, IterationSummary* iteration) {
  InnerDescent& inner = *parts_.loop.inner_descent;
  StageClock& clock = parts_.clock;
  const double start = clock.Read();
  ++inner.num_rounds;
  PointPair& points = parts_.evaluator.points();
  // A copy of all values: the round moves them in place, and may end where nothing can be
  // evaluated.
  const std::vector<double> before = points.candidate();
  coordinate_descent_->Run();
  double cost = 0.0;
  // Back to the candidate before the round, whose cost is known, with tangent maps that are right
  // again when it is accepted.
  if (!evaluation_.CandidateCost(&cost)) {
    points.mutable_candidate() = before;
    // they were those of the point that failed
    static_cast<void>(points.ComputeCandidateTangents());
    return;
  }
  // Written so that NaN ends it. Once a round was worth too little there are no more in this
  // solve.
  if (!(1.0 - cost / cost_ > inner.tolerance)) {
    coordinate_descent_.reset();
  }
  inner.seconds += clock.Read() - start;
  // What was gained counts as promised, so that the ratio judges the step.
  promise_ += cost_ - cost;
  iteration->model_cost_change = promise_;
  descent_was_useful_ = cost < start_cost;
  cost_ = cost;
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
