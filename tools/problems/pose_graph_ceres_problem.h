#pragma once

#include <memory>
#include <vector>

#include <ceres/problem.h>

#include "inceres/io/g2o.h"
#include "inceres/status.h"
#include "tools/problems/gauge.h"
#include "tools/problems/loss_spec.h"

namespace inceres::tools {

/// The pose graph as users of Ceres write it, over poses in the caller's array (laid out like
/// PoseGraph::poses), which must outlive the result: planar poses one block [x y θ], spatial poses
/// two, position and quaternion with EigenQuaternionManifold. The poses the file fixes are
/// constant, or else the first. kInvalidArgument if an information matrix is not positive definite
/// or there is no edge.
Status BuildPoseGraphCeresProblem(const PoseGraph& graph, const LossSpec& loss, double* poses,
                                  std::unique_ptr<ceres::Problem>* problem);

/// Largest difference of positions, relative to the size of the graph, and of rotations in radians.
/// No alignment: some pose is fixed.
GeometryDifference PoseDifference(const PoseGraph& graph, const std::vector<double>& a,
                                  const std::vector<double>& b);

}  // namespace inceres::tools
