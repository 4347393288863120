#include "vins/projection_factor.h"

#include "common/pose.h"

namespace sliding_window {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Matrix23 = Eigen::Matrix<double, 2, 3>;

namespace {

// [d r / d p, d r / d theta, 0] of a pose.
void WritePoseJacobian(const Matrix23& by_p, const Matrix23& by_theta, double* jacobian) {
  Eigen::Map<Eigen::Matrix<double, 2, 7, Eigen::RowMajor>> J(jacobian);
  J << by_p, by_theta, Eigen::Vector2d::Zero();
}

}  // namespace

bool ProjectionFactor::Evaluate(double const* const* parameters, double* residuals,
                                double** jacobians) const {
  const Pose T_wi = Pose::FromParameters(parameters[0]);
  const Pose T_wj = Pose::FromParameters(parameters[1]);
  const Pose T_bc = Pose::FromParameters(parameters[2]);
  const double lambda = parameters[3][0];

  const Vector3d in_camera_i = xy_i_.homogeneous() / lambda;
  const Vector3d in_body_i = T_bc * in_camera_i;
  const Vector3d in_body_j = T_wj.Inverse() * (T_wi * in_body_i);
  const Vector3d x = T_bc.Inverse() * in_body_j;
  Eigen::Map<Eigen::Vector2d>{residuals} = weight_ * (x.hnormalized() - xy_j_);
  if (jacobians == nullptr) {
    return true;
  }

  Matrix23 by_x;
  by_x << 1.0, 0.0, -x.x() / x.z(), 0.0, 1.0, -x.y() / x.z();
  by_x *= weight_ / x.z();
  const Matrix3d R_bc = T_bc.q.toRotationMatrix();
  const Matrix23 by_body_j = by_x * R_bc.transpose();
  const Matrix23 by_world = by_body_j * T_wj.q.conjugate().toRotationMatrix();
  const Matrix23 by_body_i = by_world * T_wi.q.toRotationMatrix();
  const Matrix23 by_camera_i = by_body_i * R_bc;
  if (jacobians[0] != nullptr) {
    WritePoseJacobian(by_world, -by_body_i * Skew(in_body_i), jacobians[0]);
  }
  if (jacobians[1] != nullptr) {
    WritePoseJacobian(-by_world, by_body_j * Skew(in_body_j), jacobians[1]);
  }
  if (jacobians[2] != nullptr) {
    WritePoseJacobian(by_body_i - by_body_j, by_x * Skew(x) - by_camera_i * Skew(in_camera_i),
                      jacobians[2]);
  }
  if (jacobians[3] != nullptr) {
    Eigen::Map<Eigen::Vector2d>{jacobians[3]} = -by_camera_i * in_camera_i / lambda;
  }
  return true;
}

}  // namespace sliding_window
