#pragma once

#include <Eigen/Core>
#include <ceres/manifold.h>

#include "common/pose.h"

namespace sliding_window {

/// p + dp and Exp(theta) q: the turn is about the world's axes.
class PoseManifold : public ceres::Manifold {
 public:
  using LiftMatrix = Eigen::Matrix<double, Pose::kTangentSize, Pose::kSize, Eigen::RowMajor>;

  int AmbientSize() const override { return Pose::kSize; }
  int TangentSize() const override { return Pose::kTangentSize; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override;
  bool PlusJacobian(const double* x, double* jacobian) const override;
  bool Minus(const double* y, const double* x, double* y_minus_x) const override;
  bool MinusJacobian(const double* x, double* jacobian) const override;

  /// The MinusJacobian at a pose. What a cost function knows by tangent, times this, is its ambient
  /// Jacobian.
  static LiftMatrix Lift(const Pose& pose);
};

/// A homogeneous point (x, y, z, w), w held: a point in space, for all that solves.
class HomogeneousPointManifold : public ceres::Manifold {
 public:
  int AmbientSize() const override { return 4; }
  int TangentSize() const override { return 3; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override;
  bool PlusJacobian(const double* x, double* jacobian) const override;
  bool Minus(const double* y, const double* x, double* y_minus_x) const override;
  bool MinusJacobian(const double* x, double* jacobian) const override;
};

}  // namespace sliding_window
