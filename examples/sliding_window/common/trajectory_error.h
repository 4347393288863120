#pragma once

#include <vector>

#include <Eigen/Core>

namespace sliding_window {

/// Absolute trajectory error in meters as `evo_ape --align` states it: the root mean square of the
/// distances between estimated and true positions after the rigid motion (rotation and translation,
/// no scale) that fits the estimate to the truth best. Both as long, at least 3. Source: Umeyama,
/// Least-Squares Estimation of Transformation Parameters Between Two Point Patterns (PAMI 1991).
double AbsoluteTrajectoryError(const std::vector<Eigen::Vector3d>& estimated,
                               const std::vector<Eigen::Vector3d>& truth);

}  // namespace sliding_window
