#include "adapters/ceres/exact/callback_observer.h"

#include "adapters/ceres/plan/solve_input.h"
#include "adapters/ceres/report/progress_logger.h"
#include "adapters/ceres/report/summary_writer.h"

namespace inceres::internal {

bool CallbackObserver::IsNeeded() const {
  return evaluation_callback_ != nullptr || options_.update_state || !options_.callbacks.empty() ||
         (options_.logs && LogsProgress(options_.to_stdout));
}

void CallbackObserver::BeforeEvaluation(const double* state, bool jacobians, bool new_point) {
  if (evaluation_callback_ != nullptr) {
    WriteToUser(blocks_, state);
    evaluation_callback_->PrepareForEvaluation(jacobians, new_point);
  }
}

ObserverAction CallbackObserver::EndOfIteration(const IterationSummary& iteration, const double* best_state) {
  if (options_.update_state) {
    WriteToUser(blocks_, best_state);
  }
  IterationSummary with_fixed_cost = iteration;
  with_fixed_cost.cost += fixed_cost_;
  return ReportIteration(options_, with_fixed_cost, &callback_seconds_);
}

ObserverAction ReportIteration(const ReportOptions& options, const IterationSummary& iteration, double* callback_seconds) {
  const ceres::IterationSummary summary = ToCeres(iteration, options.eta);
  if (options.logs) {
    LogProgress(summary, options.to_stdout);
  }
  for (ceres::IterationCallback* callback : options.callbacks) {
    const WallClock clock;
    const ceres::CallbackReturnType answer = (*callback)(summary);
    *callback_seconds += clock.Seconds();
    switch (answer) {
      case ceres::SOLVER_CONTINUE:
        break;
      case ceres::SOLVER_TERMINATE_SUCCESSFULLY:
        return ObserverAction::kTerminateSuccessfully;
      case ceres::SOLVER_ABORT:
        return ObserverAction::kAbort;
    }
  }
  return ObserverAction::kContinue;
}

}  // namespace inceres::internal
