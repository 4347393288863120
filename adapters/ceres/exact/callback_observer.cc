#include "adapters/ceres/exact/callback_observer.h"

#include <iostream>
#include <string>

#include <glog/logging.h>

#include "adapters/ceres/report/summary_writer.h"
#include "inceres/solver/callbacks.h"
#include "src/base/stopwatch.h"

namespace inceres::internal {
namespace {

// Whether LogProgress would print anything.
bool LogsProgress(bool to_stdout) {
  return to_stdout || VLOG_IS_ON(1);
}

// Ceres's progress table, to standard output (flushed) or to VLOG(1).
void LogProgress(const IterationSummary& iteration, bool to_stdout) {
  if (!LogsProgress(to_stdout)) {
    return;
  }
  const std::string text =
      (iteration.iteration == 0 ? ProgressHeading() + "\n" : "") + ProgressRow(iteration);
  if (to_stdout) {
    std::cout << text << std::endl;
  } else {
    VLOG(1) << text;
  }
}

}  // namespace

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
    LogProgress(iteration, options.to_stdout);
  }
  for (ceres::IterationCallback* callback : options.callbacks) {
    ceres::CallbackReturnType answer = ceres::SOLVER_CONTINUE;
    *callback_seconds += SecondsOf([&] { answer = (*callback)(summary); });
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
