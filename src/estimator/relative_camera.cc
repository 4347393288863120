#include "estimator/relative_camera.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Geometry>

namespace inceres::internal {
namespace {

using Eigen::Vector3d;

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
  const Eigen::Matrix3d camera_from_world = (j.R * c.R).transpose();
  A = camera_from_world * i.R * c.R;
  b = camera_from_world * (i.R * c.p + i.p - j.p) - c.R.transpose() * c.p;
}

Vector3d RelativeCamera::Point(const Feature& feature) const {
  return A * Vector3d(feature.m[0], feature.m[1], 1.0) + feature.lambda * b;
}

bool RelativeCamera::Project(const Feature& feature, std::array<double, 2>* point) const {
  const Vector3d h = Point(feature);
  *point = {h.x() / h.z(), h.y() / h.z()};
  return h.z() > 0.0;
}

Vector3d PointInWorld(const Feature& feature, const double* pose, const double* body_from_camera) {
  const Pose body(pose), c(body_from_camera);
  return body.R * (c.R * Vector3d(feature.m[0], feature.m[1], 1.0) / feature.lambda + c.p) + body.p;
}

void Triangulation::AddView(const RelativeCamera& camera, const std::array<double, 2>& z) {
  const Vector3d at_infinity = camera.Point({m_, 0.0});
  double squared_distance = 0.0;
  for (int k = 0; k < 2; ++k) {
    const double seen = z[static_cast<std::size_t>(k)];
    const double offset = at_infinity[k] - seen * at_infinity.z();
    const double slope = camera.b[k] - seen * camera.b.z();
    squares_ += slope * slope;
    product_ += slope * offset;
    squared_distance += offset * offset;
  }
  if (at_infinity.z() > 0.0) {
    parallax_ = std::max(parallax_, std::sqrt(squared_distance) / at_infinity.z());
  }
}

}  // namespace inceres::internal
