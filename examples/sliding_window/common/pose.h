#pragma once

#include <cmath>

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace sliding_window {

/// [v]x, the matrix with [v]x a = v x a.
inline Eigen::Matrix3d Skew(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0.0, -v.z(), v.y(), v.z(), 0.0, -v.x(), -v.y(), v.x(), 0.0;
  return m;
}

/// The rotation by |phi| about phi.
inline Eigen::Quaterniond Exp(const Eigen::Vector3d& phi) {
  const double half = 0.5 * phi.norm();
  // sin(h) / (2 h), by its series where the division loses digits.
  const double scale = half < 1e-4 ? 0.5 - half * half / 12.0 : 0.5 * std::sin(half) / half;
  return {std::cos(half), scale * phi.x(), scale * phi.y(), scale * phi.z()};
}

/// The phi of length at most pi with Exp(phi) = q (or -q, the same rotation).
inline Eigen::Vector3d Log(const Eigen::Quaterniond& q) {
  const double sine = q.vec().norm();
  // atan(sine / w) / sine, by its series where the division loses digits.
  const double half = std::atan(sine / q.w());
  return 2.0 * (sine < 1e-4 ? (1.0 - sine * sine / (3.0 * q.w() * q.w())) / q.w() : half / sine) *
         q.vec();
}

/// J_r with Exp(phi + d) = Exp(phi) Exp(J_r d) to first order in d.
inline Eigen::Matrix3d RightJacobian(const Eigen::Vector3d& phi) {
  const double angle2 = phi.squaredNorm();
  const double angle = std::sqrt(angle2);
  const Eigen::Matrix3d K = Skew(phi);
  if (angle < 1e-4) {
    return Eigen::Matrix3d::Identity() - 0.5 * K + K * K / 6.0;
  }
  return Eigen::Matrix3d::Identity() - (1.0 - std::cos(angle)) / angle2 * K +
         (angle - std::sin(angle)) / (angle2 * angle) * K * K;
}

/// A rigid motion x -> q x + p. As a parameter block: p, then q as x y z w (7 doubles).
struct Pose {
  static constexpr int kSize = 7;
  static constexpr int kTangentSize = 6;

  Eigen::Vector3d p = Eigen::Vector3d::Zero();
  Eigen::Quaterniond q = Eigen::Quaterniond::Identity();

  static Pose FromParameters(const double* x) {
    return {Eigen::Vector3d(x[0], x[1], x[2]), Eigen::Quaterniond(x[6], x[3], x[4], x[5])};
  }
  void ToParameters(double* x) const {
    Eigen::Map<Eigen::Vector3d>{x} = p;
    Eigen::Map<Eigen::Quaterniond>{x + 3} = q;
  }

  Pose Inverse() const { return {q.conjugate() * -p, q.conjugate()}; }
  Pose operator*(const Pose& other) const { return {q * other.p + p, q * other.q}; }
  Eigen::Vector3d operator*(const Eigen::Vector3d& x) const { return q * x + p; }
};

}  // namespace sliding_window
