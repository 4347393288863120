#include "incremental/step_attempts.h"

#include <cmath>
#include <cstdint>
#include <limits>

#include "base/stopwatch.h"

namespace inceres::internal {

bool StepAttempts::Take(bool* refreshed, double* gain_ratio) {
  StepControl& control = context_.control;
  TrialStep& step = context_.system.step();
  double norm = -1.0;  // looked for when it is needed: mostly the radius is infinite
  if (control.radius() < HUGE_VAL) {
    norm = step.ScaledNorm();
    // Cut before it is tried: the radius has been found by steps like this one.
    if (norm > control.radius()) {
      norm = control.radius();
      step.Shorten(norm);
      context_.row().shortened = true;
    }
  }
  // Each turn costs an evaluation of the touched factors. The loop ends with an accepted step, with
  // Jacobians to blame, or when the shortenings are used up.
  for (int attempt = 0;; ++attempt) {
    const bool accepted =
        Evaluate(gain_ratio) && *gain_ratio > context_.options.min_relative_decrease;
    // A good step with an infinite radius needs no length: the radius stays infinite.
    if (norm < 0.0 && !(accepted && control.IsGood(*gain_ratio))) {
      norm = step.ScaledNorm();
    }
    if (accepted) {
      control.AdaptRadius(*gain_ratio, norm);
      return true;
    }
    context_.stop.StepRefused();
    // Refresh before retreat. A step that was not evaluated predicts 0, and all its old Jacobians
    // are renewed.
    *refreshed = context_.relinearization.RefreshTouched(
        /*evaluated=*/context_.row().model_cost_change > 0.0);
    if (*refreshed || !control.MayShorten(attempt)) {
      // Damping takes over, or the next step rests on other Jacobians: either way it is another
      // path.
      control.GiveUpRadius();
      return false;
    }
    ++context_.summary->num_shortened_steps;
    context_.row().shortened = true;
    norm = control.Shorten(norm);
    step.Shorten(norm);
  }
}

// The gain ratio ϱ over the touched factors; −1 where the step cannot be evaluated or its model
// promises nothing, so that it is refused whatever min_relative_decrease is.
bool StepAttempts::Evaluate(double* gain_ratio) {
  UpdateSummary& summary = *context_.summary;
  TrialStep& step = context_.system.step();
  const StageTimer timer(&summary.evaluate_seconds);
  double change = 0.0;
  double predicted = 0.0;
  const Status status = step.Evaluate(&change, &predicted);
  const bool evaluated = status.ok();
  // The first one of the Update is told.
  if (!evaluated && summary.failed_step.empty()) {
    summary.failed_step = status.message;
  }
  for (const IncrementalFamily& family : context_.system.families()) {
    // Counted also where the evaluation broke off: the budget errs on the safe side.
    summary.num_evaluated_factors += static_cast<std::int64_t>(step.Touched(family.id()).size());
  }
  *gain_ratio = evaluated && predicted > 0.0 ? -change / predicted : -1.0;
  UpdateIteration& row = context_.row();
  row.step = UpdateStep::kFrames;
  row.step_norm = step.Norm();
  // A candidate without a cost counts as the largest number.
  row.cost_change = evaluated ? -change : -std::numeric_limits<double>::max();
  row.model_cost_change = evaluated ? predicted : 0.0;
  row.relative_decrease = evaluated ? *gain_ratio : std::numeric_limits<double>::lowest();
  return evaluated;
}

// Values move before factors are looked at, since the errors of old linearizations follow from the
// residuals there; the lists of the step are needed until the end.
void StepAttempts::Accept() {
  const StageTimer timer(&context_.summary->accept_seconds);
  context_.row().step_is_successful = true;
  context_.summary->num_updated_landmarks += context_.system.AcceptValues();
  context_.relinearization.MarkStale(context_.Tolerance());
  // What was applied is no longer part of the step still to take; the rest stays for the next one.
  frame_step_.TakeOff(context_.active.frames());
  context_.system.step().End();
}

}  // namespace inceres::internal
