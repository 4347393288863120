#pragma once

#include <Eigen/Core>
#include <ceres/sized_cost_function.h>

#include "common/pose.h"

namespace sliding_window {

/// A pose known: r = sqrt(information) [p - p_0; 2 vec(q q_0^-1)], information per coordinate
/// (world axes, zero for none).
class PoseError : public ceres::SizedCostFunction<6, 7> {
 public:
  using Vector6 = Eigen::Matrix<double, 6, 1>;
  PoseError(const Pose& pose, const Vector6& information)
      : pose_(pose), sqrt_information_(information.cwiseSqrt()) {}

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  Pose pose_;
  Vector6 sqrt_information_;
};

/// Speed and biases (v, bg, ba) known: r = sqrt(information) (x - x_0).
class SpeedAndBiasError : public ceres::SizedCostFunction<9, 9> {
 public:
  using Vector9 = Eigen::Matrix<double, 9, 1>;
  SpeedAndBiasError(const Vector9& speed_bias, const Vector9& information)
      : speed_bias_(speed_bias), sqrt_information_(information.cwiseSqrt()) {}

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  Vector9 speed_bias_, sqrt_information_;
};

}  // namespace sliding_window
