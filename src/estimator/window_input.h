#pragma once

#include <vector>

#include "inceres/estimator/sliding_window_estimator.h"

namespace inceres::internal {

/// kInvalidArgument naming what is not finite, or a standard deviation that is not positive.
Status CheckStart(const WindowStart& start);

/// kInvalidArgument naming a track that is there twice or a point that is not finite.
Status CheckObservations(double time, const std::vector<WindowObservation>& observations);

/// The same of a frame: also its time, which must come after that of the last one. Its samples are
/// for InterpolateImuSamples to judge.
Status CheckFrame(double last_time, const WindowFrame& frame);

}  // namespace inceres::internal
