#pragma once

#include <vector>

#include "tools/sim/street_scene.h"
#include "tools/sim/street_view.h"

namespace inceres::internal {

/// The nine BAL parameters of a true camera.
std::array<double, BalProblem::kCameraSize> ToBal(const StreetCamera& camera);

/// Fills in x and y of every observation from the cameras and points of the problem.
void ProjectAll(BalProblem* problem);

/// Start values and measurements from the truth, as the noise knobs say; also marks the outliers.
void AddNoise(const StreetSceneOptions& options, StreetScene* scene);

}  // namespace inceres::internal
