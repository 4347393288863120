#pragma once

#include <array>
#include <vector>

#include "inceres/estimator/sliding_window_estimator.h"

namespace inceres::internal {

/// Whether the quaternion of [p(3), q(x, y, z, w)] is of length 1, to 1e-6.
bool HasUnitQuaternion(const std::array<double, 7>& pose);

/// kInvalidArgument naming what is not finite, or a standard deviation that is not positive.
Status CheckStart(const WindowStart& start);

/// kInvalidArgument naming a track that is there twice or a point that is not finite.
Status CheckObservations(double time, const std::vector<WindowObservation>& observations);

/// The same of a frame: also its time, which must come after that of the last one, and its samples,
/// which must be finite, of increasing times.
Status CheckFrame(double last_time, const WindowFrame& frame);

}  // namespace inceres::internal
