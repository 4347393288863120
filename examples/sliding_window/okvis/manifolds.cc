#include "okvis/manifolds.h"

namespace sliding_window {

using Eigen::Matrix3d;
using Eigen::Vector3d;

bool PoseManifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  Pose pose = Pose::FromParameters(x);
  pose.p += Eigen::Map<const Vector3d>(delta);
  pose.q = (Exp(Eigen::Map<const Vector3d>(delta + 3)) * pose.q).normalized();
  pose.ToParameters(x_plus_delta);
  return true;
}

bool PoseManifold::PlusJacobian(const double* x, double* jacobian) const {
  const Pose pose = Pose::FromParameters(x);
  Eigen::Map<Eigen::Matrix<double, 7, 6, Eigen::RowMajor>> J(jacobian);
  J.setZero();
  J.topLeftCorner<3, 3>().setIdentity();
  J.block<3, 3>(3, 3) = 0.5 * (pose.q.w() * Matrix3d::Identity() - Skew(pose.q.vec()));
  J.block<1, 3>(6, 3) = -0.5 * pose.q.vec().transpose();
  return true;
}

bool PoseManifold::Minus(const double* y, const double* x, double* y_minus_x) const {
  const Pose to = Pose::FromParameters(y);
  const Pose from = Pose::FromParameters(x);
  Eigen::Map<Vector3d>{y_minus_x} = to.p - from.p;
  Eigen::Map<Vector3d>{y_minus_x + 3} = Log(to.q * from.q.conjugate());
  return true;
}

bool PoseManifold::MinusJacobian(const double* x, double* jacobian) const {
  Eigen::Map<LiftMatrix>{jacobian} = Lift(Pose::FromParameters(x));
  return true;
}

PoseManifold::LiftMatrix PoseManifold::Lift(const Pose& pose) {
  LiftMatrix J = LiftMatrix::Zero();
  J.topLeftCorner<3, 3>().setIdentity();
  J.block<3, 3>(3, 3) = 2.0 * (pose.q.w() * Matrix3d::Identity() + Skew(pose.q.vec()));
  J.block<3, 1>(3, 6) = -2.0 * pose.q.vec();
  return J;
}

bool HomogeneousPointManifold::Plus(const double* x, const double* delta,
                                    double* x_plus_delta) const {
  Eigen::Map<Vector3d>{x_plus_delta} =
      Eigen::Map<const Vector3d>(x) + Eigen::Map<const Vector3d>(delta);
  x_plus_delta[3] = x[3];
  return true;
}

bool HomogeneousPointManifold::PlusJacobian(const double* /*x*/, double* jacobian) const {
  Eigen::Map<Eigen::Matrix<double, 4, 3, Eigen::RowMajor>>{jacobian}.setIdentity();
  return true;
}

bool HomogeneousPointManifold::Minus(const double* y, const double* x, double* y_minus_x) const {
  Eigen::Map<Vector3d>{y_minus_x} = Eigen::Map<const Vector3d>(y) - Eigen::Map<const Vector3d>(x);
  return true;
}

bool HomogeneousPointManifold::MinusJacobian(const double* /*x*/, double* jacobian) const {
  Eigen::Map<Eigen::Matrix<double, 3, 4, Eigen::RowMajor>>{jacobian}.setIdentity();
  return true;
}

}  // namespace sliding_window
