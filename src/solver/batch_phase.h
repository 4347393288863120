#pragma once

#include <atomic>

#include "inceres/graph/factor_graph.h"
#include "inceres/solver/incremental_options.h"
#include "inceres/solver/update_summary.h"

namespace inceres::internal {

/// Whether the batch solver takes graphs like this: one from which factors were removed has places it knows nothing of.
bool TakesBatchPhase(const FactorGraph& graph);

struct BatchOutcome {
  Termination termination = Termination::kFailure;
  /// The last steps shrank so fast that what is left is below the tolerance too.
  bool finished = false;
};

/// The part of an Update that the batch solver does: from the graph's state to what its own stopping rule leaves. Counts go into
/// the summary; so does a failure, and the state is then what it was.
BatchOutcome RunBatchPhase(const IncrementalOptions& options, const std::atomic<bool>& stop, FactorGraph* graph,
                           UpdateSummary* summary);

}  // namespace inceres::internal
