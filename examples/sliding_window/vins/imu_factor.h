#pragma once

#include <memory>

#include <ceres/sized_cost_function.h>

#include "common/imu_preintegration.h"

namespace sliding_window {

/// The IMU between frames i and j (EvaluateImuResidual). Parameter blocks: pose i (7), speed and
/// biases i (9: v, ba, bg), pose j, speed and biases j. Shares the preintegration with the
/// estimator.
class ImuFactor : public ceres::SizedCostFunction<15, 7, 9, 7, 9> {
 public:
  explicit ImuFactor(std::shared_ptr<const ImuPreintegration> imu) : imu_(std::move(imu)) {}

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  std::shared_ptr<const ImuPreintegration> imu_;
};

/// A state from, and to, its two parameter blocks.
ImuState StateFromParameters(const double* pose, const double* speed_bias);
void StateToParameters(const ImuState& state, double* pose, double* speed_bias);

}  // namespace sliding_window
