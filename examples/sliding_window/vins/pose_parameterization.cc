#include "vins/pose_parameterization.h"

namespace sliding_window {

bool PoseParameterization::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  Pose pose = Pose::FromParameters(x);
  pose.p += Eigen::Map<const Eigen::Vector3d>(delta);
  pose.q = (pose.q * Eigen::Quaterniond(1.0, 0.5 * delta[3], 0.5 * delta[4], 0.5 * delta[5]))
               .normalized();
  pose.ToParameters(x_plus_delta);
  return true;
}

bool PoseParameterization::ComputeJacobian(const double* /*x*/, double* jacobian) const {
  Eigen::Map<Eigen::Matrix<double, Pose::kSize, Pose::kTangentSize, Eigen::RowMajor>>(jacobian)
      .setIdentity();
  return true;
}

}  // namespace sliding_window
