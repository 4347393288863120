#include "incremental/batch_observer.h"

#include <utility>

namespace inceres::internal {

// What ends a batch phase before Ceres's own rules would (docs/algorithms.md, "One-time solves and
// exact windows"). Two predictions of what is left are made from what the loop reports anyway:
//
//     before a step:  max(1, last ϱ) · promise / (1 − φ),   φ = promise / last promise,
//     after it:       gain · r / (1 − r),                   r = gain / last gain.
//
// Both are sums of geometric series, and both are believed only where the damping hides nothing
// (SeesAll, SeesEnough). The tolerance is relative to the cost less its fixed part. With
// batch_share 0 neither ends a solve, which is Ceres's then, iterate for iterate.
//
// Kept between calls are the last promise, gain, ratio and gain ratio. An infinite ratio or
// promise, or a gain of 0, stands for "none": every test below is written so that it fails with
// them, and with a NaN that they lead to.

// Each call counts as an evaluation of all factors.
void BatchObserver::BeforeEvaluation(const double* /*state*/, bool jacobians, bool /*new_point*/) {
  UpdateSummary& summary = trace_.summary();
  if (jacobians) {
    summary.num_relinearized_factors += call_.graph->num_factors();
  } else {
    summary.num_evaluated_factors += call_.graph->num_factors();
  }
}

// A solve that ends here saves the evaluation of the candidate and the linearization behind it.
bool BatchObserver::IsWorthTrying(const IterationSummary& iteration, const StepOrigin& origin) {
  const double cost = origin.cost;
  within_rounding_ = origin.within_rounding;
  const double promise = iteration.model_cost_change;
  // Zero for the first step, for last_promise_ is infinite then; `known` is false there by
  // last_ratio_.
  const double factor = promise / last_promise_;
  // Of no use where the factor is 1 or more, which `known` rules out.
  const double rest = std::max(1.0, last_ratio_) * promise / (1.0 - factor);
  const bool known = last_ratio_ > tuning_.kept_promise && factor < tuning_.steady_factor;
  // Not by Marquardt's rule: it is there for descents whose series have misled before.
  const bool series = known && !IsByMarquardt() && rest <= tuning_.rest_share * Tolerance(cost);
  // A small promise by itself is an end only where no other solver goes on from there.
  const bool nothing = call_.end == BatchEnd::kToTheEnd && promise <= Allowed(cost);
  tried_radius_ = iteration.trust_region_radius;
  held_back_ = origin.held_back;
  // Next to a cost of nothing, whatever damping holds back counts, though it is rounding as well.
  const bool blurred = call_.end == BatchEnd::kToTheEnd && within_rounding_ && IsHardlyDamped();
  // All of it only as far as the model sees weak directions: with much damping a promise is small
  // because steps are short.
  const bool claims =
      options_.batch_share > 0.0 && (blurred || (SeesEnough() && (series || nothing)));
  // A step that is worth it is tried first: near a saddle, or where the cost is less curved than
  // its model, it gains more than it has promised.
  tries_claim_ = claims && !blurred && promise > tuning_.no_gain_share * Tolerance(cost);
  num_refusing_ = origin.num_refusing;
  settled_ = claims && !tries_claim_;
  if (hold_.on) {
    hold_.is_over = settled_ || tries_claim_;
    settled_ = tries_claim_ = false;
  }
  rest_ = !claims ? 0.0 : series ? rest : promise;
  promises_nothing_ = SeesAll() && promise <= Tolerance(cost);
  last_promise_ = promise;
  return !settled_;
}

// The second prediction, by gains. Asked before Jacobians are evaluated at the new point, so an end
// here saves a linearization.
bool BatchObserver::IsLast(const IterationSummary& iteration) {
  last_judged_ = iteration.iteration;
  if (iteration.step_share < 1.0) {  // its gain is what the border left of it
    previous_gain_ = 0.0;
    previous_ratio_ = HUGE_VAL;
    return false;
  }
  const double rest = rest_;
  settled_ = HasJustSettled(iteration);
  // A claim that was tried holds if its model did.
  if (!settled_ && tries_claim_ &&
      KeepsPromise(iteration.cost_change, iteration.model_cost_change)) {
    settled_ = true;
    rest_ = std::max(rest - iteration.cost_change, 0.0);
  }
  if (hold_.on) {
    hold_.is_over |= std::exchange(settled_, false);
  }
  return settled_;
}

// What the next step is judged by.
void BatchObserver::NoteIteration(const IterationSummary& iteration) {
  if (iteration.step_is_successful) {
    // A success that IsLast was not asked of is the start, or has made the cost another function by
    // moving expansion points: costs of before do not compare.
    cost_ = iteration.cost;
    best_cost_ = iteration.iteration == last_judged_ ? std::min(best_cost_, cost_) : cost_;
  }
  pace_.Note(iteration.iteration, cost_);
  num_accepted_in_row_ = iteration.step_is_successful ? num_accepted_in_row_ + 1 : 0;
  refused_radius_ = iteration.step_is_successful ? refused_radius_ : tried_radius_;
  WaitAfterRefusal(iteration);
  // What landmarks gained by themselves says nothing of the model.
  last_ratio_ = iteration.model_cost_change == last_promise_ ? iteration.relative_decrease : 0.0;
  // Of a step that is rounding its gain is, too, and whether it was taken.
  is_near_ =
      options_.batch_share > 0.0 &&
      (within_rounding_ || (iteration.step_is_successful && last_ratio_ > tuning_.kept_promise &&
                            iteration.cost_change <= tuning_.near_gain * Tolerance(cost_)));
  if (iteration.step_is_successful &&
      iteration.iteration != last_judged_) {  // the start, or the cost is another function
    stagnation_.Begin(cost_);
  }
}

ObserverAction BatchObserver::EndOfIteration(const IterationSummary& iteration,
                                             const double* best_state) {
  NoteIteration(iteration);
  // A second part of a solve begins with a row of the state in which the first one has ended.
  if (iteration.iteration == 0 &&
      !trace_.summary().iterations.empty()) {  // told as the end of the part before
    return call_.stop.load(std::memory_order_relaxed) ? ObserverAction::kTerminateSuccessfully
                                                      : ObserverAction::kContinue;
  }
  WriteRow(iteration);
  *call_.shown_state = best_state;
  const bool go_on = trace_.EndRow(cost_);
  *call_.shown_state = nullptr;
  // After the row is written: the trace shows the iteration that these verdicts rest on.
  if (!settled_ && IsRefusedForNothing(iteration)) {
    settled_ = true;
    rest_ = iteration.model_cost_change;
  }
  if (!settled_ && HasStagnated(iteration)) {
    settled_ = true;
    rest_ = -1.0;
  }
  if (hold_.on && (hold_.is_over || settled_ || !IsWorthHolding(iteration))) {
    EndHold();
  }
  if (!go_on) {
    ended_by_user_ = true;
    // EndRow has written the termination that the observer asks for; the loop is told the same.
    return trace_.summary().termination == Termination::kUserSuccess
               ? ObserverAction::kTerminateSuccessfully
               : ObserverAction::kAbort;
  }
  // Refused, the start, or one that made the cost another function: the next is compared with none.
  if (!iteration.step_is_successful || iteration.iteration != last_judged_) {
    previous_gain_ = 0.0;
    previous_ratio_ = HUGE_VAL;
    last_ratio_ = 0.0;
  }
  return settled_ || stagnates_ || HasSpentBudget() || IsOutOfPatience(iteration)
             ? ObserverAction::kTerminateSuccessfully
             : ObserverAction::kContinue;
}

// Where Marquardt's rule is to go on: the strategy that was asked for has had its iterations, and
// is not on its way to an end by those that are left.
bool BatchObserver::IsOutOfPatience(const IterationSummary& iteration) const {
  return call_.end == BatchEnd::kToTheEnd && options_.batch_share > 0.0 && !IsByMarquardt() &&
         iteration.iteration >= tuning_.patience &&
         !IsOnItsWay(pace_.gained(), cost_ - options_.fixed_cost,
                     options_.max_num_iterations - iteration.iteration);
}

// On request, or all evaluations are made.
bool BatchObserver::HasSpentBudget() const {
  const UpdateSummary& summary = trace_.summary();
  return call_.stop.load(std::memory_order_relaxed) ||
         summary.num_evaluated_factors + summary.num_relinearized_factors >=
             options_.max_factor_evaluations;
}

// Hardly damped steps that are refused are tried again after two steps, five, eleven, …
void BatchObserver::WaitAfterRefusal(const IterationSummary& iteration) {
  if (iteration.step_is_successful) {
    // A success brings the next trial nearer; a refusal of a step that was not hardly damped does
    // not count.
    steps_to_wait_ = std::max(0, steps_to_wait_ - 1);
  } else if (is_near_ && steps_to_wait_ == 0) {
    steps_to_wait_ = wait_;
    wait_ = 2 * wait_ + 1;
  }
}

// By Marquardt's rule only: by the others a step is refused for its length alone.
bool BatchObserver::HasStagnated(const IterationSummary& iteration) {
  if (!IsByMarquardt() || options_.batch_share == 0.0 || iteration.iteration == 0) {
    return false;
  }
  // tried_radius_ is that of the step, where iteration.trust_region_radius is already the one after
  // it.
  const Stagnation::Verdict verdict =
      stagnation_.After(iteration, cost_, Tolerance(cost_), tried_radius_);
  if (hold_.on) {
    return verdict != Stagnation::Verdict::kGoOn;
  }
  if (num_refusing_ > 0 && (verdict == Stagnation::Verdict::kRefusals ||
                            (verdict == Stagnation::Verdict::kUnproven && stagnation_.creeps()))) {
    BeginHold(verdict);
    return false;
  }
  // The end that no model confirms is named as such.
  trace_.summary().rests_on_refusals |= verdict == Stagnation::Verdict::kRefusals;
  stagnates_ = verdict == Stagnation::Verdict::kUnproven;
  if (verdict != Stagnation::Verdict::kGoOn) {
    words_ = stagnation_.InWords(verdict, cost_);
  }
  return verdict == Stagnation::Verdict::kProven || verdict == Stagnation::Verdict::kRefusals;
}

// Where steps are stopped by a border, whatever their length, the variables of those who refuse are
// held, and the others go on.
void BatchObserver::BeginHold(Stagnation::Verdict verdict) {
  words_ = stagnation_.InWords(verdict, cost_);
  hold_.on = true;
  hold_.is_over = false;
  hold_.proves = verdict == Stagnation::Verdict::kRefusals;
  hold_.from_cost = cost_;
  stagnation_.BeginAtBorder(cost_, /*refused=*/false);
}

// Where no claim can follow, Ceres's rule is enough: the gain of one step.
bool BatchObserver::IsWorthHolding(const IterationSummary& iteration) const {
  return iteration.step_is_valid &&
         (hold_.proves || num_refusing_ == 1 || !iteration.step_is_successful ||
          iteration.cost_change > Tolerance(cost_));
}

// The others are at their minimum. If that was worth it, all go on from there. If not, it is the
// end: a minimum, if those who are held have one direction only, which is refused, or if steps of
// all lengths have been.
void BatchObserver::EndHold() {
  const double gained = hold_.from_cost - cost_;
  hold_.on = false;
  settled_ = stagnates_ = false;
  const bool proves = hold_.proves || num_refusing_ == 1;
  const bool is_there = gained <= Allowed(cost_);
  const bool is_near = gained <= Tolerance(cost_);
  // What refusals have proven they have of where it was, and next to that: once more, if need be.
  const bool was_near = std::exchange(hold_.is_near, is_near);
  if (!is_near || (proves && !is_there && !was_near)) {
    words_.clear();
    stagnation_.BeginAtBorder(cost_, hold_.proves && is_near);
    return;
  }
  settled_ = proves && is_there;
  stagnates_ = !settled_;
  if (stagnates_) {
    words_ = Stagnation::kCreeps;
  } else if (!hold_.proves) {
    words_ =
        "A cost function refuses all lengths of steps in the one direction in which there is "
        "anything to gain.";
  }
  trace_.summary().rests_on_refusals |= settled_;
  rest_ = -1.0;
}

// A step that was evaluated and refused, but changes next to nothing: there is nothing to be had.
// (Ceres's rule does not ask whether a step is accepted either.)
bool BatchObserver::IsRefusedForNothing(const IterationSummary& iteration) const {
  return call_.end == BatchEnd::kToTheEnd && options_.batch_share > 0.0 &&
         iteration.iteration > 0 && iteration.step_is_valid && !iteration.step_is_successful &&
         SeesAll() &&
         std::fabs(iteration.cost_change) <= tuning_.settled_share * Tolerance(cost_) &&
         iteration.model_cost_change <= Tolerance(cost_);
}

// The rule in full: good steps whose model is exact enough, whose gains fall fast twice in a row,
// or at all, below the tolerance, in a solve that nothing follows; and whose series is below what
// may be left.
bool BatchObserver::HasJustSettled(const IterationSummary& iteration) {
  // Gains far above the promise are as bad: so much less is the cost curved than its model.
  const bool good = std::fabs(iteration.relative_decrease - 1.0) < 1.0 - tuning_.good_model;
  const double gain = good ? iteration.cost_change : 0.0;
  const double allowed = Allowed(iteration.cost);
  // Steps whose gains fall by a ratio r leave gain · r / (1 − r) undone.
  const double ratio = gain / previous_gain_;
  // The slower of the last two ratios: one lucky step does not make a series.
  const double slower = std::max(ratio, previous_ratio_);
  const bool fast = ratio < tuning_.fast_ratio && previous_ratio_ < tuning_.fast_ratio;
  // Slow ones are believed where they are all there is, and Ceres's rule would have ended the
  // solve.
  const bool slow =
      call_.end == BatchEnd::kToTheEnd && slower < 1.0 && gain <= Tolerance(iteration.cost);
  // What the model was wrong by in this step may still be there: the gradient is off by as much.
  const bool exact = std::fabs(gain - iteration.model_cost_change) <= allowed;
  const bool settled = options_.batch_share > 0.0 && SeesAll() && good && exact && gain >= 0.0 &&
                       (fast || slow) && gain * slower / (1.0 - slower) <= allowed;
  // For remaining_decrease of the summary.
  rest_ = settled ? gain * slower / (1.0 - slower) : 0.0;
  previous_gain_ = gain;
  previous_ratio_ = ratio;
  return settled;
}

// The batch solver's row in the columns of an Update's: its damping is one over the radius, and a
// Dog-Leg has none.
void BatchObserver::WriteRow(const IterationSummary& iteration) {
  UpdateIteration& row = trace_.row();
  row.step =
      iteration.iteration > 0 && iteration.step_is_valid ? UpdateStep::kBatch : UpdateStep::kNone;
  row.step_is_successful = iteration.step_is_successful;
  row.cost_change = iteration.cost_change;
  row.model_cost_change = iteration.model_cost_change;
  row.relative_decrease = iteration.relative_decrease;
  row.step_norm = iteration.step_norm;
  row.gradient_max_norm = iteration.gradient_max_norm;
  row.gradient_norm = iteration.gradient_norm;
  row.damping = IsDamped(options_.batch_strategy) ? 1.0 / iteration.trust_region_radius : 0.0;
  row.trust_region_radius = iteration.trust_region_radius;
  row.linear_solver_iterations = iteration.linear_solver_iterations;
  row.step_solver_time_in_seconds = iteration.step_solver_time_in_seconds;
}

}  // namespace inceres::internal
