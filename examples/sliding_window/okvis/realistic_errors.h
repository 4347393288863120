#pragma once

#include <mutex>
#include <vector>

#include <Eigen/Core>
#include <ceres/sized_cost_function.h>

#include "common/imu_preintegration.h"

namespace sliding_window {

/// A pinhole camera with radial and tangential distortion (k1, k2, p1, p2), pixels.
struct DistortedCamera {
  double focal_length = 1.0;
  Eigen::Vector2d center = Eigen::Vector2d::Zero();
  Eigen::Vector4d distortion = Eigen::Vector4d::Zero();

  /// The image of a homogeneous point and, if not null, its derivative with respect to that.
  Eigen::Vector2d Project(const Eigen::Vector4d& point,
                          Eigen::Matrix<double, 2, 4>* jacobian) const;
};

/// ReprojectionError, computed as estimators in the field compute it: each parameter block becomes
/// a 4 x 4 transformation, the image goes through a camera model with all its coefficients, and
/// minimal Jacobians of full shape, partly of dynamic size, are chained and lifted. The same
/// residuals and Jacobians up to rounding, at several times the cost.
class RealisticReprojectionError : public ceres::SizedCostFunction<2, 7, 4, 7> {
 public:
  /// Seen at xy on the image plane at depth 1, by a camera of that focal length in pixels;
  /// `pixel_sigma`: the standard deviation.
  RealisticReprojectionError(const Eigen::Vector2d& xy, double focal_length, double pixel_sigma);

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  DistortedCamera camera_;
  Eigen::Vector2d keypoint_;
  Eigen::Matrix2d sqrt_information_;
};

/// ImuError in the same way: its Jacobians are chained from full 15 x 15 matrices. Has the same
/// memory.
class RealisticImuError : public ceres::SizedCostFunction<15, 7, 9, 7, 9> {
 public:
  RealisticImuError(const ImuNoise& noise, const std::vector<ImuSample>& samples,
                    const Eigen::Vector3d& ba, const Eigen::Vector3d& bg)
      : imu_(noise, samples, ba, bg) {}

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  mutable std::mutex mutex_;  // guards what follows
  mutable ImuPreintegration imu_;
};

}  // namespace sliding_window
