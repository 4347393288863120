#pragma once

#include "inceres/solver/incremental_options.h"
#include "inceres/solver/incremental_solver.h"

namespace inceres::internal {

/// All who look on while an Update works, as one observer: first the table of progress, then the
/// user's observer, then the callback of the options. Who ends the Update is the last to be asked.
class UpdateListeners final : public UpdateObserver {
 public:
  /// Borrows both for the length of an Update; `observer` may be null.
  UpdateListeners(const IncrementalOptions& options, UpdateObserver* observer)
      : options_(options), observer_(observer) {}

  /// What the trace is to ask: null if nobody looks on.
  UpdateObserver* AsObserver() {
    return observer_ != nullptr || options_.progress || options_.callback ? this : nullptr;
  }

  ObserverAction EndOfIteration(const UpdateIteration& iteration) override {
    if (options_.progress) {
      if (iteration.iteration == 0) {
        options_.progress(UpdateProgressHeading());
      }
      options_.progress(ProgressRow(iteration));
    }
    const ObserverAction action =
        observer_ != nullptr ? observer_->EndOfIteration(iteration) : ObserverAction::kContinue;
    return action == ObserverAction::kContinue && options_.callback ? options_.callback(iteration)
                                                                    : action;
  }

 private:
  const IncrementalOptions& options_;
  UpdateObserver* const observer_;
};

}  // namespace inceres::internal
