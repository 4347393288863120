#pragma once

#include <vector>

#include "inceres/solver/live_covariance.h"
#include "incremental/incremental_system.h"

namespace inceres::internal {

/// Adds what FactorStaleness counts of the factors of a variable that moves, and of the step that
/// the last Update saw for it and did not take. `frame_step`: that of all frames, packed by rows.
void CountStaleness(const IncrementalSystem& system, const std::vector<double>& frame_step,
                    VariableId id, FactorStaleness* staleness);

}  // namespace inceres::internal
