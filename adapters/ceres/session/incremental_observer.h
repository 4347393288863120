#pragma once

#include <functional>
#include <optional>
#include <utility>
#include <vector>

#include <ceres/solver.h>

#include "adapters/ceres/exact/callback_observer.h"
#include "adapters/ceres/read/introspection.h"
#include "adapters/ceres/read/user_state.h"
#include "inceres/solver/incremental_solver.h"
#include "inceres/solver/summary.h"

namespace inceres::internal {

/// What of a solve does not show in its Update.
struct SolveContext {
  double fixed_cost = 0.0;      ///< of what touches no variable block, and is not in the graph
  double seconds_before = 0.0;  ///< spent before the Update began
  std::optional<int> last_iteration = std::nullopt;  ///< SolveInput::last_iteration
};

/// Keeps Ceres's promises at the end of an iteration of an incremental solve, as CallbackObserver
/// does in exact mode, and writes the trace in the terms of IterationSummary.
///
/// While it lives and update_state_every_iteration is on, the user's memory follows the solve. It
/// is as before when this object is gone (an exception out of user code included), unless Keep was
/// called.
class IncrementalObserver : public UpdateObserver {
 public:
  /// Borrows all for the length of a solve. `write` puts the best state so far into the user's
  /// memory.
  IncrementalObserver(const ceres::Solver::Options& options, const ProblemView& view,
                      std::function<void()> write, const SolveContext& context);

  ObserverAction EndOfIteration(const UpdateIteration& iteration) override;
  /// What is in the user's memory stays.
  void Keep() {
    if (start_values_) {
      start_values_->Keep();
    }
  }
  std::vector<IterationSummary> TakeTrace() { return std::move(trace_); }
  /// Spent in the user's iteration callbacks so far.
  double callback_seconds() const { return callback_seconds_; }

 private:
  const ReportOptions options_;
  const std::function<void()> write_;
  const SolveContext context_;
  std::optional<StartValues> start_values_;  // where there may be something to put back
  std::vector<IterationSummary> trace_;
  double callback_seconds_ = 0.0;
};

/// One row of an Update's trace as Ceres would tell it: costs with the fixed one, of a
/// refused step that of its candidate; the radius is 1 / damping.
IterationSummary ToIterationSummary(const UpdateIteration& row, const SolveContext& context);

}  // namespace inceres::internal
