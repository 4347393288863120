#pragma once

#include <vector>

#include "common/run.h"

namespace sliding_window {

/// What an estimator starts with, beside the truth.
struct Start {
  ImuState state;
  std::vector<Pose> body_from_cameras;
};

Start MakeStart(const RunOptions& options, const Simulator& simulator);

}  // namespace sliding_window
