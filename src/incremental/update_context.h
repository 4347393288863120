#pragma once

#include <atomic>

#include "inceres/solver/incremental_options.h"
#include "incremental/active_set.h"
#include "incremental/incremental_system.h"
#include "incremental/relinearization.h"
#include "incremental/shares.h"
#include "incremental/step_control.h"
#include "incremental/stopping_rule.h"
#include "incremental/tuning.h"
#include "incremental/update_trace.h"

namespace inceres::internal {

/// What the parts of an incremental Update share: the system, the rules they go by, and where they
/// write what they did. It outlives Updates, as the damping in it does; between two of them there
/// is no trace.
struct UpdateContext {
  UpdateContext(const IncrementalOptions& user_options, const Tuning& thresholds,
                IncrementalSystem* living)
      : options(user_options),
        tuning(thresholds),
        system(*living),
        control(tuning, options, options.initial_damping),
        relinearization(tuning.relinearize, living),
        active(tuning.truncate) {}

  /// An Update begins. `is_mostly_new`: far from the minimum, where half a step leads elsewhere
  /// than a whole one; all of it moves.
  void Begin(bool is_mostly_new, const std::atomic<bool>& stop_request, UpdateTrace* update_trace);
  /// Ends the iteration; false if the observer ends the Update.
  bool EndIteration();
  /// Whether a limit, or the user, ends the Update.
  bool OutOfBudget() const;
  /// The Update ends like this.
  void Finish(Termination termination, const char* message);
  /// T of docs/algorithms.md, "Stopping rule".
  double Tolerance() const { return stop.Tolerance(system.cost()); }
  /// StoppingRule::IsLittleLeft of what is left now. Where that may rest on how much of the cost is
  /// rounding, residuals are looked at first.
  bool IsLittleLeft(double remaining, double landmark_gain);
  UpdateIteration& row() { return trace->row(); }

  IncrementalOptions options;
  const Tuning tuning;
  IncrementalSystem& system;
  StepControl control;
  StoppingRule stop;
  Relinearization relinearization;
  ActiveSet active;
  // Of the Update under way.
  bool mostly_new = false;
  Shares shares;
  const std::atomic<bool>* stop_requested = nullptr;
  UpdateTrace* trace = nullptr;
  UpdateSummary* summary = nullptr;  // the trace's
};

}  // namespace inceres::internal
