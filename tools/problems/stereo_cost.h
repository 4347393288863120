#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <ceres/autodiff_cost_function.h>

#include "inceres/factors/point_reprojection.h"

namespace inceres::tools {

/// A point seen by a stereo camera as users of Ceres write it, for AutoDiff: blocks and residuals
/// are those of StereoReprojectionFamily.
struct StereoReprojectionError {
  StereoObservation seen;
  StereoCamera camera;

  template <typename T>
  bool operator()(const T* body, const T* body_from_camera, const T* point, T* residuals) const {
    using Vector = Eigen::Matrix<T, 3, 1>;
    using Point = Eigen::Map<const Vector>;
    using Rotation = Eigen::Map<const Eigen::Quaternion<T>>;
    const Vector in_body = Rotation(body + 3).conjugate() * (Point(point) - Point(body));
    const Vector h =
        Rotation(body_from_camera + 3).conjugate() * (in_body - Point(body_from_camera));
    const T u = camera.f_x * h[0] / h[2] + camera.c_x;
    Vector e(u - seen.left[0], camera.f_y * h[1] / h[2] + camera.c_y - seen.left[1],
             u - camera.f_x * camera.baseline / h[2] - seen.right_u);
    const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> U(seen.sqrt_information);
    Eigen::Map<Vector>(residuals).noalias() = U.cast<T>() * e;
    return true;
  }

  static ceres::CostFunction* Create(const StereoObservation& seen, const StereoCamera& camera) {
    return new ceres::AutoDiffCostFunction<StereoReprojectionError, 3, 7, 7, 3>(
        new StereoReprojectionError{seen, camera});
  }
};

}  // namespace inceres::tools
