#include "okvis/reprojection_error.h"

#include "okvis/manifolds.h"

namespace sliding_window {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Matrix23 = Eigen::Matrix<double, 2, 3>;

namespace {

constexpr double kMinDepth = 0.2;  // m

void WritePoseJacobian(const Matrix23& by_p, const Matrix23& by_theta, const Pose& pose,
                       double* jacobian) {
  Eigen::Matrix<double, 2, 6> J;
  J << by_p, by_theta;
  Eigen::Map<Eigen::Matrix<double, 2, 7, Eigen::RowMajor>>{jacobian} = J * PoseManifold::Lift(pose);
}

}  // namespace

bool ReprojectionError::Evaluate(double const* const* parameters, double* residuals,
                                 double** jacobians) const {
  const Pose T_ws = Pose::FromParameters(parameters[0]);
  const Pose T_sc = Pose::FromParameters(parameters[2]);
  const Vector3d landmark(parameters[1]);
  const double w = parameters[1][3];

  const Vector3d from_body = landmark - w * T_ws.p;
  const Vector3d from_camera = T_ws.q.conjugate() * from_body - w * T_sc.p;
  const Vector3d c = T_sc.q.conjugate() * from_camera;
  Eigen::Map<Eigen::Vector2d>{residuals} = weight_ * (c.hnormalized() - xy_);
  if (jacobians == nullptr) {
    return true;
  }

  Matrix23 by_c = Matrix23::Zero();
  if (c.z() >= kMinDepth * w) {
    by_c << 1.0, 0.0, -c.x() / c.z(), 0.0, 1.0, -c.y() / c.z();
    by_c *= weight_ / c.z();
  }
  const Matrix23 by_body = by_c * T_sc.q.conjugate().toRotationMatrix();
  const Matrix23 by_world = by_body * T_ws.q.conjugate().toRotationMatrix();
  if (jacobians[0] != nullptr) {
    WritePoseJacobian(-w * by_world, by_world * Skew(from_body), T_ws, jacobians[0]);
  }
  if (jacobians[1] != nullptr) {
    Eigen::Map<Eigen::Matrix<double, 2, 4, Eigen::RowMajor>>{jacobians[1]} << by_world,
        -by_world * T_ws.p - by_body * T_sc.p;
  }
  if (jacobians[2] != nullptr) {
    WritePoseJacobian(-w * by_body, by_body * Skew(from_camera), T_sc, jacobians[2]);
  }
  return true;
}

}  // namespace sliding_window
