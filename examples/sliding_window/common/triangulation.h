#pragma once

#include <optional>
#include <vector>

#include <Eigen/Core>

#include "common/pose.h"

namespace sliding_window {

/// A line of sight: the point lies at camera * (depth * (x, y, 1)).
struct Sight {
  Pose world_from_camera;
  Eigen::Vector2d xy;
};

/// The world point nearest to all lines of sight (least squares). Nothing if they are nearly
/// parallel or the point is not in front of every camera.
std::optional<Eigen::Vector3d> Triangulate(const std::vector<Sight>& sights);

}  // namespace sliding_window
