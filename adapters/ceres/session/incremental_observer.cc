#include "adapters/ceres/session/incremental_observer.h"

namespace inceres::internal {

IterationSummary ToIterationSummary(const UpdateIteration& row, const SolveContext& context) {
  IterationSummary result;
  result.iteration = row.iteration + context.last_iteration.value_or(0);
  result.step_is_valid = row.step != UpdateStep::kNone || row.iteration == 0;
  result.step_is_successful = row.step_is_successful;
  // cost is that of before: the step was refused
  const double candidate_cost = row.cost - row.cost_change;
  result.cost = (row.step_is_successful ? row.cost : candidate_cost) + context.fixed_cost;
  result.cost_change = row.cost_change;
  result.gradient_max_norm = row.gradient_max_norm;
  result.gradient_norm = row.gradient_norm;
  result.step_norm = row.step_norm;
  result.model_cost_change = row.model_cost_change;
  result.relative_decrease = row.relative_decrease;
  result.trust_region_radius = row.damping > 0.0 ? 1.0 / row.damping : row.trust_region_radius;
  result.linear_solver_iterations = row.linear_solver_iterations;
  result.iteration_time_in_seconds = row.iteration_time_in_seconds;
  result.step_solver_time_in_seconds = row.step_solver_time_in_seconds;
  result.cumulative_time_in_seconds = context.seconds_before + row.cumulative_time_in_seconds;
  return result;
}

IncrementalObserver::IncrementalObserver(const ceres::Solver::Options& options,
                                         const ProblemView& view, std::function<void()> write,
                                         const SolveContext& context)
    : options_(options), write_(std::move(write)), context_(context) {
  if (options_.update_state) {
    start_values_.emplace(view);
  }
}

ObserverAction IncrementalObserver::EndOfIteration(const UpdateIteration& iteration) {
  trace_.push_back(ToIterationSummary(iteration, context_));
  if (options_.update_state) {
    write_();
  }
  // from the part before
  const bool is_known = iteration.iteration == 0 && context_.last_iteration.has_value();
  return is_known ? ObserverAction::kContinue
                  : ReportIteration(options_, trace_.back(), &callback_seconds_);
}

}  // namespace inceres::internal
