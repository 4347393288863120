#pragma once

#include <algorithm>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <ceres/autodiff_cost_function.h>
#include <ceres/rotation.h>

#include "inceres/factors/body_reprojection.h"
#include "inceres/factors/relative_pose.h"

namespace inceres::tools {

/// The factors of keyframe problems as users of Ceres write them, for AutoDiff. A pose is a block
/// of 7: center p, world_from_camera quaternion x, y, z, w. The residuals are those of the built-in
/// families of the same names.
struct InverseDepthReprojectionError {
  InverseDepthReprojectionFamily::Measurement measurement;

  template <typename T>
  bool operator()(const T* pose_a, const T* pose_b, const T* inverse_depth, T* residuals) const {
    using Vector = Eigen::Matrix<T, 3, 1>;
    const Eigen::Map<const Vector> p_a(pose_a), p_b(pose_b);
    const Eigen::Map<const Eigen::Quaternion<T>> q_a(pose_a + 3), q_b(pose_b + 3);
    const Vector ray(T(measurement.anchor_point[0]), T(measurement.anchor_point[1]), T(1.0));
    const Vector h = q_b.conjugate() * (q_a * ray + inverse_depth[0] * (p_a - p_b));
    const T e_x = h[0] / h[2] - measurement.observed_point[0];
    const T e_y = h[1] / h[2] - measurement.observed_point[1];
    residuals[0] = measurement.sqrt_information[0] * e_x + measurement.sqrt_information[1] * e_y;
    residuals[1] = measurement.sqrt_information[2] * e_y;
    return true;
  }

  static ceres::CostFunction* Create(
      const InverseDepthReprojectionFamily::Measurement& measurement) {
    return new ceres::AutoDiffCostFunction<InverseDepthReprojectionError, 2, 7, 7, 1>(
        new InverseDepthReprojectionError{measurement});
  }
};

struct RelativePoseError {
  RelativePoseFamily::Measurement measurement;

  template <typename T>
  bool operator()(const T* pose_a, const T* pose_b, T* residuals) const {
    using Vector = Eigen::Matrix<T, 3, 1>;
    const Eigen::Map<const Vector> p_a(pose_a), p_b(pose_b);
    const Eigen::Map<const Eigen::Quaternion<T>> q_a(pose_a + 3), q_b(pose_b + 3);
    const Eigen::Map<const Eigen::Quaterniond> q_ab(measurement.q_ab);
    const Eigen::Map<const Eigen::Vector3d> p_ab(measurement.p_ab);
    const Eigen::Quaternion<T> error = q_a.conjugate() * q_b * q_ab.conjugate().cast<T>();
    const T scalar_first[4] = {error.w(), error.x(), error.y(), error.z()};
    Eigen::Matrix<T, 6, 1> e;
    ceres::QuaternionToAngleAxis(scalar_first, e.data());
    e.template tail<3>() = q_b.conjugate() * (p_a - p_b) - p_ab.cast<T>();
    const Eigen::Map<const Eigen::Matrix<double, 6, 6, Eigen::RowMajor>> U(
        measurement.sqrt_information);
    Eigen::Map<Eigen::Matrix<T, 6, 1>>(residuals).noalias() = U.cast<T>() * e;
    return true;
  }

  static ceres::CostFunction* Create(const RelativePoseFamily::Measurement& measurement) {
    return new ceres::AutoDiffCostFunction<RelativePoseError, 6, 7, 7>(
        new RelativePoseError{measurement});
  }
};

/// A prior on the first kSize of kAmbientSize coordinates.
template <int kSize, int kAmbientSize>
struct DiagonalPriorError {
  double mean[kSize];
  double sqrt_information[kSize];

  template <typename T>
  bool operator()(const T* x, T* residuals) const {
    for (int k = 0; k < kSize; ++k) {
      residuals[k] = sqrt_information[k] * (x[k] - mean[k]);
    }
    return true;
  }

  static ceres::CostFunction* Create(const double* mean, const double* sqrt_information) {
    auto* error = new DiagonalPriorError;
    std::copy_n(mean, kSize, error->mean);
    std::copy_n(sqrt_information, kSize, error->sqrt_information);
    return new ceres::AutoDiffCostFunction<DiagonalPriorError, kSize, kAmbientSize>(error);
  }
};

}  // namespace inceres::tools
