#pragma once

#include <atomic>

#include "inceres/solver/incremental_options.h"
#include "incremental/active_set.h"
#include "incremental/incremental_system.h"
#include "incremental/relinearization.h"
#include "incremental/step_control.h"
#include "incremental/stopping_rule.h"
#include "incremental/tuning.h"
#include "incremental/update_trace.h"

namespace inceres::internal {

/// The shares of IncrementalOptions, with IncrementalOptions::kByGraph resolved. Under
/// RelinearizationRule::kStepSize the first only says on what convergence may rest, whatever the
/// graph.
struct Shares {
  double relinearization = 0.0;
  double truncation = 0.0;
};

inline Shares SharesOf(const IncrementalOptions& options, int num_landmarks) {
  const auto resolve = [](double share, double by_graph) {
    return share == IncrementalOptions::kByGraph ? by_graph : share;
  };
  const bool by_error = options.relinearization == RelinearizationRule::kResidualError;
  return {resolve(options.relinearization_share, num_landmarks > 0 || !by_error ? 0.1 : 0.003),
          resolve(options.truncation_share, num_landmarks > 0 ? 0.03 : 0.0)};
}

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
