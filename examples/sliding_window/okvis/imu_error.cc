#include "okvis/imu_error.h"

#include "common/imu_residual.h"
#include "okvis/manifolds.h"

namespace sliding_window {

using Imu = ImuPreintegration;

namespace {

// A turn of this many radians over the interval is more than first order in the bias describes
// well.
constexpr double kMaxBiasTurn = 1e-4;

// J has columns p, theta (body axes), v, ba, bg.
void WriteJacobians(const Imu::Matrix15& J, const Pose& pose, double* pose_jacobian,
                    double* speed_bias_jacobian) {
  if (pose_jacobian != nullptr) {
    Eigen::Matrix<double, 15, 6> J_pose = J.leftCols<6>();
    J_pose.rightCols<3>() *= pose.q.conjugate().toRotationMatrix();
    Eigen::Map<Eigen::Matrix<double, 15, 7, Eigen::RowMajor>>{pose_jacobian} =
        J_pose * PoseManifold::Lift(pose);
  }
  if (speed_bias_jacobian != nullptr) {
    Eigen::Map<Eigen::Matrix<double, 15, 9, Eigen::RowMajor>>{speed_bias_jacobian}
        << J.middleCols<3>(Imu::kV),
        J.middleCols<3>(Imu::kBg), J.middleCols<3>(Imu::kBa);
  }
}

}  // namespace

ImuState StateFromBlocks(const double* pose, const double* speed_bias) {
  const auto part = [speed_bias](int begin) {
    return Eigen::Map<const Eigen::Vector3d>(speed_bias + begin);
  };
  return {Pose::FromParameters(pose), part(0), part(6), part(3)};
}

void StateToBlocks(const ImuState& state, double* pose, double* speed_bias) {
  state.pose.ToParameters(pose);
  Eigen::Map<Eigen::Matrix<double, 9, 1>>(speed_bias) << state.v, state.bg, state.ba;
}

bool ImuError::Evaluate(double const* const* parameters, double* residuals,
                        double** jacobians) const {
  const ImuState i = StateFromBlocks(parameters[0], parameters[1]);
  const ImuState j = StateFromBlocks(parameters[2], parameters[3]);
  const std::lock_guard<std::mutex> lock(mutex_);
  if ((i.bg - imu_.bg()).norm() * imu_.dt() > kMaxBiasTurn) {
    imu_.Repropagate(i.ba, i.bg);
    ++num_integrations_;
  }
  Imu::Vector15 r;
  Imu::Matrix15 J_i;
  Imu::Matrix15 J_j;
  const bool with_jacobians = jacobians != nullptr;
  EvaluateImuResidual(imu_, i, j, &r, with_jacobians ? &J_i : nullptr,
                      with_jacobians ? &J_j : nullptr);
  Eigen::Map<Imu::Vector15>{residuals} = r;
  if (with_jacobians) {
    WriteJacobians(J_i, i.pose, jacobians[0], jacobians[1]);
    WriteJacobians(J_j, j.pose, jacobians[2], jacobians[3]);
  }
  return true;
}

}  // namespace sliding_window
