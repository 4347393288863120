#include "estimator/relative_camera.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Geometry>

// The geometry of a window's views outside the solver: triangulation, tests after a solve and
// landmarks that move to another anchor. It is the model of BodyReprojectionFamily for one camera
// and two poses (docs/visual_inertial.md, "Visual factors"),
//     h = R_cᵀ (R_jᵀ (R_i (R_c m + λ t_c) + λ (p_i − p_j)) − λ t_c) = A m + λ b,
// with A and b formed once per pair of frames. A is a rotation, so λ enters only through b, the
// baseline as camera j sees it. h is smooth at λ = 0: a point at infinity needs no case of its own,
// where a parametrization by depth would divide by zero.

namespace inceres::internal {
namespace {

using Eigen::Vector3d;

// [p(3), q(x, y, z, w)] as everywhere in the graph; Eigen's constructor takes w first.
struct Pose {
  explicit Pose(const double* values)
      : p(values[0], values[1], values[2]),
        R(Eigen::Quaterniond(values[6], values[3], values[4], values[5]).toRotationMatrix()) {}
  Vector3d p;
  Eigen::Matrix3d R;
};

}  // namespace

RelativeCamera::RelativeCamera(const double* pose_i, const double* pose_j,
                               const double* body_from_camera) {
  const Pose i(pose_i), j(pose_j), c(body_from_camera);
  // A turns a bearing of camera i into camera j, b moves it by the baseline: with no rotation at
  // all A is I and b is R_cᵀ R_jᵀ (p_i − p_j).
  const Eigen::Matrix3d camera_from_world = (j.R * c.R).transpose();
  A = camera_from_world * i.R * c.R;
  b = camera_from_world * (i.R * c.p + i.p - j.p) - c.R.transpose() * c.p;
}

Vector3d RelativeCamera::Point(const Feature& feature) const {
  return A * Vector3d(feature.m[0], feature.m[1], 1.0) + feature.lambda * b;
}

bool RelativeCamera::Project(const Feature& feature, std::array<double, 2>* point) const {
  const Vector3d h = Point(feature);
  // Returned behind the camera too, where it is the mirror image; the sign of h_z alone tells. NaN
  // in h makes the comparison false.
  *point = {h.x() / h.z(), h.y() / h.z()};
  return h.z() > 0.0;
}

Vector3d PointInWorld(const Feature& feature, const double* pose, const double* body_from_camera) {
  // λ times the point is m in the camera at i, so the division by λ is what goes from bearing to
  // point.
  const Pose body(pose), c(body_from_camera);
  return body.R * (c.R * Vector3d(feature.m[0], feature.m[1], 1.0) / feature.lambda + c.p) + body.p;
}

void Triangulation::AddView(const RelativeCamera& camera, const std::array<double, 2>& z) {
  // Where the feature would be if it had no depth at all, λ = 0. What differs from it is parallax.
  const Vector3d at_infinity = camera.Point({m_, 0.0});
  double squared_distance = 0.0;
  for (int k = 0; k < 2; ++k) {
    const double seen = z[static_cast<std::size_t>(k)];
    // z × h = 0 has two independent rows, h_k − z_k h_z = 0, which are linear in λ: offset + λ
    // slope = 0. They are not divided by h_z, which is unknown before λ is; so a view counts in
    // proportion to its depth times λ, which is near 1 unless the camera comes much closer.
    const double offset = at_infinity[k] - seen * at_infinity.z();
    const double slope = camera.b[k] - seen * camera.b.z();
    squares_ += slope * slope;
    product_ += slope * offset;
    squared_distance += offset * offset;
  }
  // Divided by the depth of the far point: offset is then a distance in the plane z = 1, seen from
  // the direction of view j. One that looks away from the far point has no such distance, and does
  // not count.
  if (at_infinity.z() > 0.0) {
    parallax_ = std::max(parallax_, std::sqrt(squared_distance) / at_infinity.z());
  }
}

}  // namespace inceres::internal
