#pragma once

#include "inceres/problem/factor_graph.h"
#include "inceres/solver/incremental_options.h"
#include "inceres/solver/options.h"
#include "incremental/batch_observer.h"
#include "incremental/tuning.h"

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

/// What the batch solver is asked for, but for the observer.
SolverOptions BatchOptions(const IncrementalOptions& options, const Tuning::Batch& tuning,
                           BatchEnd end);

/// The part of an Update, or of a one-time solve, that one call of the batch solver does: from the
/// graph's state to what its own stopping rule leaves. Counts and rows go into the trace and its
/// summary; so does a failure, and the state is then what it was, as after an observer's kAbort.
BatchOutcome RunPart(const BatchCall& call);

}  // namespace inceres::internal
