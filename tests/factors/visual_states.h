#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "factors/numeric_jacobian.h"
#include "inceres/factors/point_reprojection.h"
#include "inceres/problem/manifolds.h"
#include "inceres/problem/rotation.h"

namespace inceres::test {

/// The formulas of the visual factors once more, in long double and the long way round: points are
/// moved through the frames as metric points, by quaternions, never scaled by an inverse depth or a
/// homogeneous coordinate.
using Real = long double;
using Vector3 = std::array<Real, 3>;

inline Vector3 CrossOf(const Vector3& a, const Vector3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

/// q v q* or, with sign −1, q* v q.
inline Vector3 Turn(const double* q, const Vector3& v, Real sign = 1) {
  const Vector3 u{sign * q[0], sign * q[1], sign * q[2]};
  const Vector3 uv = CrossOf(u, v);
  const Vector3 uuv = CrossOf(u, uv);
  return {v[0] + 2 * (q[3] * uv[0] + uuv[0]), v[1] + 2 * (q[3] * uv[1] + uuv[1]),
          v[2] + 2 * (q[3] * uv[2] + uuv[2])};
}

/// A point of the frame of `pose` in the frame the pose is in, and back.
inline Vector3 OutOf(const std::vector<double>& pose, const Vector3& v) {
  const Vector3 turned = Turn(pose.data() + 3, v);
  return {turned[0] + pose[0], turned[1] + pose[1], turned[2] + pose[2]};
}
inline Vector3 Into(const std::vector<double>& pose, const Vector3& v) {
  return Turn(pose.data() + 3, {v[0] - pose[0], v[1] - pose[1], v[2] - pose[2]}, -1);
}

inline Vector3 Unit(const Vector3& v) {
  const Real norm = std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
  return {v[0] / norm, v[1] / norm, v[2] / norm};
}

/// A pose within a meter of the origin, any rotation.
inline std::vector<double> RandomPose(Random& random) {
  std::vector<double> pose = random.Vector(7);
  RandomRotation(random, random.Between(0.0, 3.1), pose.data() + 3);
  return pose;
}

/// A landmark seen by a camera on a body: what the parameters of such a factor may be, on manifolds
/// of that perturbation.
struct SeenLandmark {
  FactorState state;
  Vector3 in_camera;  ///< meters
};

inline SeenLandmark RandomSeenLandmark(Random& random, LandmarkKind kind,
                                       const Manifold* pose_manifold,
                                       const Manifold* landmark_manifold) {
  SeenLandmark seen;
  const std::vector<double> body = RandomPose(random), camera = RandomPose(random);
  // In front of the camera or, one in four, behind it.
  const double depth = random.Below(4) == 0 ? random.Between(-8.0, -0.6) : random.Between(0.6, 8.0);
  seen.in_camera = {0.6 * random.Unit() * depth, 0.6 * random.Unit() * depth, depth};
  const Vector3 X = OutOf(body, OutOf(camera, seen.in_camera));
  std::vector<double> landmark;
  const double omega = kind == LandmarkKind::kPoint ? 1.0 : random.Between(0.1, 2.0);
  for (const Real coordinate : X) {
    landmark.push_back(static_cast<double>(coordinate) * omega);
  }
  if (kind == LandmarkKind::kHomogeneous) {
    landmark.push_back(omega);
  }
  seen.state = {{body, camera, landmark}, {pose_manifold, pose_manifold, landmark_manifold}};
  return seen;
}

}  // namespace inceres::test
