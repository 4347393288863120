#include "vins/imu_factor.h"

#include "common/imu_residual.h"

namespace sliding_window {

using Imu = ImuPreintegration;

ImuState StateFromParameters(const double* pose, const double* speed_bias) {
  const auto part = [speed_bias](int begin) {
    return Eigen::Map<const Eigen::Vector3d>(speed_bias + begin);
  };
  return {Pose::FromParameters(pose), part(0), part(3), part(6)};
}

void StateToParameters(const ImuState& state, double* pose, double* speed_bias) {
  state.pose.ToParameters(pose);
  Eigen::Map<Eigen::Matrix<double, 9, 1>>(speed_bias) << state.v, state.ba, state.bg;
}

bool ImuFactor::Evaluate(double const* const* parameters, double* residuals,
                         double** jacobians) const {
  const ImuState i = StateFromParameters(parameters[0], parameters[1]);
  const ImuState j = StateFromParameters(parameters[2], parameters[3]);
  Imu::Vector15 r;
  if (jacobians == nullptr) {
    EvaluateImuResidual(*imu_, i, j, &r, nullptr, nullptr);
    Eigen::Map<Imu::Vector15>{residuals} = r;
    return true;
  }
  Imu::Matrix15 J_i;
  Imu::Matrix15 J_j;
  EvaluateImuResidual(*imu_, i, j, &r, &J_i, &J_j);
  Eigen::Map<Imu::Vector15>{residuals} = r;
  for (const int frame : {0, 1}) {
    const Imu::Matrix15& J = frame == 0 ? J_i : J_j;
    if (double* pose = jacobians[2 * frame]) {
      Eigen::Map<Eigen::Matrix<double, 15, 7, Eigen::RowMajor>>{pose} << J.leftCols<6>(),
          Imu::Vector15::Zero();
    }
    if (double* speed_bias = jacobians[2 * frame + 1]) {
      Eigen::Map<Eigen::Matrix<double, 15, 9, Eigen::RowMajor>>{speed_bias} = J.rightCols<9>();
    }
  }
  return true;
}

}  // namespace sliding_window
