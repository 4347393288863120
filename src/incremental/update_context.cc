#include "incremental/update_context.h"

#include "base/stopwatch.h"

namespace inceres::internal {
void UpdateContext::Begin(bool is_mostly_new, const std::atomic<bool>& stop_request,
                          UpdateTrace* update_trace) {
  mostly_new = is_mostly_new;
  stop_requested = &stop_request;
  trace = update_trace;
  summary = &trace->summary();
  shares = SharesOf(options, system.schur().structure().num_landmarks());
  // μ goes on from where the last Update left it; the radius and what refusals have proven do not.
  control = StepControl(tuning, options, control.mu());
  relinearization.Begin(options, shares.relinearization);
  active.Clear();
}

bool UpdateContext::EndIteration() {
  row().damping = control.mu();
  row().trust_region_radius = control.radius();
  // A pass over all variables, which nobody pays for who does not look on.
  if (trace->observed()) {
    system.schur().RhsNorms(&row().gradient_max_norm, &row().gradient_norm);
  }
  return trace->EndRow(system.cost());
}

bool UpdateContext::IsLittleLeft(double remaining, double landmark_gain) {
  const double cost = system.cost();
  if (stop.AsksForRounding(remaining, cost)) {
    stop.SetRounding(system.rounding().OfResiduals());
  }
  return stop.IsLittleLeft(remaining, landmark_gain, cost, summary->num_iterations, mostly_new);
}

// Counts first; the clock is asked last.
bool UpdateContext::OutOfBudget() const {
  return summary->num_iterations >= options.max_num_iterations ||
         stop_requested->load(std::memory_order_relaxed) ||
         summary->num_evaluated_factors + summary->num_relinearized_factors >=
             options.max_factor_evaluations ||
         NowInSeconds() - trace->start_seconds() >= options.max_solver_time_in_seconds;
}

void UpdateContext::Finish(Termination termination, const char* message) {
  summary->termination = termination;
  summary->message = message;
  // The batch phase before has said so of its own end.
  summary->ended_by_batch_rule = false;
}

}  // namespace inceres::internal
