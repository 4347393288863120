#pragma once

#include <vector>

#include "inceres/solver/incremental_options.h"
#include "inceres/solver/live_covariance.h"
#include "incremental/frame_step.h"
#include "incremental/incremental_system.h"
#include "incremental/live_gauge.h"
#include "incremental/undamped_factor.h"

namespace inceres::internal {

/// What covariances are taken from: a system that an Update has left, and the factor of its S.
struct LiveSource {
  const FactorGraph& graph;
  IncrementalSystem& system;  // nothing of it changes but who has seen which rows of S
  const FrameStep& frames;
  UndampedFactor* undamped;
  WeakestDirection* weakest;  // by the damped factor
};

/// Nothing, with the memory it had.
void Clear(LiveCovariance* covariance);

/// IncrementalSolver::Covariance, of a factor that belongs to the system.
Status ComputeLiveCovariance(const LiveSource& source, const std::vector<VariableId>& ids,
                             const LiveCovarianceOptions& options, LiveCovariance* covariance);

}  // namespace inceres::internal
