#include "adapters/ceres/exact/callback_observer.h"

#include <cstdio>
#include <iostream>

#include <glog/logging.h>

#include "adapters/ceres/plan/solve_input.h"
#include "adapters/ceres/report/summary_writer.h"

namespace inceres::internal {
namespace {

// Whether LogProgress would print anything.
bool LogsProgress(bool to_stdout) {
  return to_stdout || VLOG_IS_ON(1);
}

// To standard output (flushed) or to VLOG(1).
void LogProgress(const ceres::IterationSummary& iteration, bool to_stdout) {
  if (to_stdout) {
    std::cout << ProgressText(iteration) << std::endl;
  } else {
    VLOG(1) << ProgressText(iteration);
  }
}

}  // namespace

std::string ProgressText(const ceres::IterationSummary& iteration) {
  char row[256];
  std::snprintf(row, sizeof(row),
                "% 4d % 8e   % 3.2e   % 3.2e  % 3.2e  % 3.2e % 3.2e     % 4d   % 3.2e   % 3.2e",
                iteration.iteration, iteration.cost, iteration.cost_change,
                iteration.gradient_max_norm, iteration.step_norm, iteration.relative_decrease,
                iteration.trust_region_radius, iteration.linear_solver_iterations,
                iteration.iteration_time_in_seconds, iteration.cumulative_time_in_seconds);
  const char* heading =
      "iter      cost      cost_change  |gradient|   |step|    tr_ratio  tr_radius  ls_iter  "
      "iter_time  total_time\n";
  return iteration.iteration == 0 ? std::string(heading) + row : row;
}

bool CallbackObserver::IsNeeded() const {
  return is_to_abort_ || evaluation_callback_ != nullptr || options_.update_state ||
         !options_.callbacks.empty() || (options_.logs && LogsProgress(options_.to_stdout));
}

void CallbackObserver::BeforeEvaluation(const double* state, bool jacobians, bool new_point) {
  if (evaluation_callback_ != nullptr) {
    WriteToUser(blocks_, state);
    evaluation_callback_->PrepareForEvaluation(jacobians, new_point);
  }
}

ObserverAction CallbackObserver::EndOfIteration(const IterationSummary& iteration,
                                                const double* best_state) {
  if (options_.update_state) {
    WriteToUser(blocks_, best_state);
  }
  IterationSummary with_fixed_cost = iteration;
  with_fixed_cost.cost += fixed_cost_;
  const ObserverAction action = ReportIteration(options_, with_fixed_cost, &callback_seconds_);
  return action == ObserverAction::kContinue && is_to_abort_ && is_to_abort_()
             ? ObserverAction::kAbort
             : action;
}

ObserverAction ReportIteration(const ReportOptions& options, const IterationSummary& iteration,
                               double* callback_seconds) {
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
