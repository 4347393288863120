#pragma once

#include "inceres/factors/imu_preintegrator.h"

namespace inceres::internal {

/// Adds the interval between two samples to what was integrated: motion, covariance, derivative
/// with respect to the biases.
void StepImu(const ImuOptions& options, const ImuSample& from, const ImuSample& to,
             ImuDelta* delta);

}  // namespace inceres::internal
