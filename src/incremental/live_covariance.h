#pragma once

#include <vector>

#include "inceres/solver/incremental_options.h"
#include "inceres/solver/live_covariance.h"
#include "incremental/frame_step.h"
#include "incremental/incremental_system.h"
#include "incremental/undamped_factor.h"

namespace inceres::internal {

/// The weakest direction of D^−½ S D^−½, remembered from one covariance to the next, for to find it
/// takes solves: what damping may hide, and whether the gauge is free.
struct WeakestDirection {
  double eigenvalue = 0.0;
  double of_landmarks = 0.0;  // what of it is the landmarks' damping
  VariableId variable = -1;   // with the largest share in it
  int num_frames = 0;         // when it was looked for
  bool is_known = false;      // and nothing was taken out of the graph since
};

/// What covariances are taken from: a system that an Update has left, and the factor of its S.
struct LiveSource {
  const FactorGraph& graph;
  IncrementalSystem& system;  // nothing of it changes but who has seen which rows of S
  const FrameStep& frames;
  UndampedFactor* undamped;
  WeakestDirection* weakest;  // by the damped factor
};

/// IncrementalSolver::Covariance, of a factor that belongs to the system.
Status ComputeLiveCovariance(const LiveSource& source, const std::vector<VariableId>& ids,
                             const LiveCovarianceOptions& options, LiveCovariance* covariance);

}  // namespace inceres::internal
