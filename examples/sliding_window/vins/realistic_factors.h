#pragma once

#include <memory>

#include <Eigen/Core>
#include <ceres/sized_cost_function.h>

#include "common/imu_preintegration.h"

namespace sliding_window {

/// ImuFactor, computed as estimators in the field compute it: at every call the covariance is
/// inverted and factored for its weight, and every block's Jacobian is filled in full and
/// multiplied by that. The same residuals and Jacobians up to rounding, at several times the cost.
class RealisticImuFactor : public ceres::SizedCostFunction<15, 7, 9, 7, 9> {
 public:
  explicit RealisticImuFactor(std::shared_ptr<const ImuPreintegration> imu)
      : imu_(std::move(imu)) {}

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  std::shared_ptr<const ImuPreintegration> imu_;
};

/// ProjectionFactor in the same way: rotation matrices multiplied out for each block, 3 x 6
/// Jacobians of the point reduced by a weighted 2 x 3 matrix.
class RealisticProjectionFactor : public ceres::SizedCostFunction<2, 7, 7, 7, 1> {
 public:
  RealisticProjectionFactor(const Eigen::Vector2d& xy_i, const Eigen::Vector2d& xy_j, double weight)
      : point_i_(xy_i.homogeneous()),
        point_j_(xy_j.homogeneous()),
        sqrt_information_(weight * Eigen::Matrix2d::Identity()) {}

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  Eigen::Vector3d point_i_, point_j_;
  Eigen::Matrix2d sqrt_information_;
};

}  // namespace sliding_window
