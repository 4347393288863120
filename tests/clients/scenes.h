#pragma once

#include <array>
#include <vector>

#include <ceres/ceres.h>

/// Scenes for programs that know nothing but Ceres, of the block sizes that programs use.
namespace clients {

struct Observation {
  int camera;
  int point;
  double x;
  double y;
};

/// Cameras on an arc that look at points around its center, each point seen by some cameras that
/// follow each other; start values beside the truth, noise in the observations, some of them wrong.
struct Reconstruction {
  Reconstruction(int num_cameras, int num_points, int track_length, double outlier_fraction);

  std::vector<std::array<double, 6>> poses;      // angle-axis and translation, world to camera
  std::vector<std::array<double, 4>> rotations;  // the same as a quaternion [w x y z]
  std::vector<std::array<double, 3>> translations;
  std::vector<std::array<double, 3>> points;
  std::array<double, 4> intrinsics;  // focal length, principal point, radial distortion
  std::vector<Observation> observations;
};

/// Blocks: pose 6, intrinsics 4, point 3.
ceres::CostFunction* PoseReprojection(const Observation& observation);
/// The same by a DynamicAutoDiffCostFunction, with a scale of its own (1) behind the others.
ceres::CostFunction* ScaledReprojection(const Observation& observation);
/// The same as the first by numeric differences.
ceres::CostFunction* NumericReprojection(const Observation& observation);
/// Blocks: rotation 4, translation 3, point 3, intrinsics 4.
ceres::CostFunction* QuaternionReprojection(const Observation& observation);

struct RelativePose {
  int from;
  int to;
  std::array<double, 3> difference;  // x, y, θ of `to` seen from `from`
};

/// Planar poses along a path that crosses itself, with loops.
struct PlanarGraph {
  explicit PlanarGraph(int num_poses);
  std::vector<std::array<double, 3>> poses;
  std::vector<RelativePose> constraints;
};

/// Blocks: pose 3, pose 3.
ceres::CostFunction* PlanarConstraint(const RelativePose& constraint);
/// Blocks: x, y, θ of one pose, then of the other.
ceres::CostFunction* ScalarConstraint(const RelativePose& constraint);

}  // namespace clients
