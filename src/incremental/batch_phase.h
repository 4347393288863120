#pragma once

#include <atomic>

#include "inceres/problem/factor_graph.h"
#include "inceres/solver/incremental_options.h"
#include "incremental/tuning.h"
#include "incremental/update_trace.h"

namespace inceres::internal {

/// Whether the batch solver takes graphs like this: one from which factors were removed has places
/// it knows nothing of.
bool TakesBatchPhase(const FactorGraph& graph);

struct BatchOutcome {
  Termination termination = Termination::kFailure;
  /// The last steps shrank so fast that what is left is below the tolerance too.
  bool finished = false;
  /// It converged with a trust region so small that more may be left than the last steps tell.
  bool held_back = false;
  /// Of a solve that Ceres's rule ended: its model promised next to nothing too, or the gradient is
  /// next to zero.
  bool promises_nothing = false;
};

/// The part of an Update that the batch solver does: from the graph's state to what its own
/// stopping rule leaves. Counts and rows go into the trace and its summary; so does a failure, and
/// the state is then what it was, as after an observer's kAbort. *shown_state is the best state so
/// far while the observer is called, laid out as the graph's, otherwise null.
BatchOutcome RunBatchPhase(const IncrementalOptions& options, const Tuning::Batch& tuning,
                           const std::atomic<bool>& stop, FactorGraph* graph,
                           const double** shown_state, UpdateTrace* trace);

}  // namespace inceres::internal
