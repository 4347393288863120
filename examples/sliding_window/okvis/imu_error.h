#pragma once

#include <mutex>
#include <vector>

#include <ceres/sized_cost_function.h>

#include "common/imu_preintegration.h"

namespace sliding_window {

/// The IMU between two frames (EvaluateImuResidual). Parameter blocks: pose (7, see PoseManifold)
/// and speed and biases (9: v, bg, ba) of both. Evaluate has a memory: when the gyroscope's bias
/// has moved away from that of the integration, it integrates anew, at the biases it is called
/// with, and goes on from there. Threads: any number.
class ImuError : public ceres::SizedCostFunction<15, 7, 9, 7, 9> {
 public:
  ImuError(const ImuNoise& noise, const std::vector<ImuSample>& samples, const Eigen::Vector3d& ba,
           const Eigen::Vector3d& bg)
      : imu_(noise, samples, ba, bg) {}

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

  int num_integrations() const { return num_integrations_; }

 private:
  mutable std::mutex mutex_;  // guards what follows
  mutable ImuPreintegration imu_;
  mutable int num_integrations_ = 1;
};

/// A state from, and to, its two parameter blocks.
ImuState StateFromBlocks(const double* pose, const double* speed_bias);
void StateToBlocks(const ImuState& state, double* pose, double* speed_bias);

}  // namespace sliding_window
