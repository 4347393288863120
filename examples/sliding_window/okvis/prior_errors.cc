#include "okvis/prior_errors.h"

#include "okvis/manifolds.h"

namespace sliding_window {

using Eigen::Matrix3d;

bool PoseError::Evaluate(double const* const* parameters, double* residuals,
                         double** jacobians) const {
  const Pose pose = Pose::FromParameters(parameters[0]);
  const Eigen::Quaterniond e = pose.q * pose_.q.conjugate();
  Eigen::Map<Vector6> r(residuals);
  r << pose.p - pose_.p, 2.0 * e.vec();
  r = sqrt_information_.cwiseProduct(r);
  if (jacobians != nullptr && jacobians[0] != nullptr) {
    Eigen::Matrix<double, 6, 6> J = Eigen::Matrix<double, 6, 6>::Identity();
    J.bottomRightCorner<3, 3>() = e.w() * Matrix3d::Identity() - Skew(e.vec());
    Eigen::Map<PoseManifold::LiftMatrix>{jacobians[0]} =
        sqrt_information_.asDiagonal() * J * PoseManifold::Lift(pose);
  }
  return true;
}

bool SpeedAndBiasError::Evaluate(double const* const* parameters, double* residuals,
                                 double** jacobians) const {
  Eigen::Map<Vector9>{residuals} =
      sqrt_information_.cwiseProduct(Eigen::Map<const Vector9>(parameters[0]) - speed_bias_);
  if (jacobians != nullptr && jacobians[0] != nullptr) {
    Eigen::Map<Eigen::Matrix<double, 9, 9, Eigen::RowMajor>>{jacobians[0]} =
        sqrt_information_.asDiagonal();
  }
  return true;
}

}  // namespace sliding_window
