#pragma once

#include <vector>

#include "common/run.h"

namespace sliding_window {

/// What a scene means: sensors, solves, and how much an image shows.
void SetScene(Scene scene, RunOptions* options);

/// What an estimator starts with.
struct Start {
  ImuState state;
  std::vector<Pose> body_from_cameras;
};

/// kHall: see Run. kStartup: as OKVIS starts, but in the air, at 2 to 3 m/s: velocity and biases
/// zero, the vertical where the accelerometer points, which the flight's acceleration tilts; each
/// camera, if its place is to be estimated, 4 mm and 6 mrad off in each axis (standard deviations).
/// Position and yaw are the true ones.
Start MakeStart(const RunOptions& options, const Simulator& simulator);

}  // namespace sliding_window
