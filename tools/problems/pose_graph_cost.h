#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <ceres/autodiff_cost_function.h>

namespace inceres::tools {

/// Error of a relative planar pose between two poses [x y θ]: L [R(θ_a)ᵀ (p_b − p_a) − p_m;
/// wrap(θ_b − θ_a − θ_m)], with LᵀL the information matrix. The angle is wrapped to (−π, π], so
/// poses need no manifold.
class Se2BetweenError {
 public:
  Se2BetweenError(const Eigen::Vector3d& measured, const Eigen::Matrix3d& sqrt_information)
      : measured_(measured), sqrt_information_(sqrt_information) {}

  template <typename T>
  bool operator()(const T* pose_a, const T* pose_b, T* residuals) const {
    using std::cos;
    using std::sin;
    const T dx = pose_b[0] - pose_a[0];
    const T dy = pose_b[1] - pose_a[1];
    const T c = cos(pose_a[2]);
    const T s = sin(pose_a[2]);
    Eigen::Matrix<T, 3, 1> error;
    error << c * dx + s * dy - measured_[0], c * dy - s * dx - measured_[1],
        Wrap(pose_b[2] - pose_a[2] - measured_[2]);
    Eigen::Map<Eigen::Matrix<T, 3, 1>> weighted(residuals);
    weighted = sqrt_information_.cast<T>() * error;
    return true;
  }

  static ceres::CostFunction* Create(const Eigen::Vector3d& measured,
                                     const Eigen::Matrix3d& sqrt_information) {
    return new ceres::AutoDiffCostFunction<Se2BetweenError, 3, 3, 3>(
        new Se2BetweenError(measured, sqrt_information));
  }

  EIGEN_MAKE_ALIGNED_OPERATOR_NEW

 private:
  template <typename T>
  static T Wrap(const T& angle) {
    using std::floor;
    constexpr double kTwoPi = 6.283185307179586;
    return angle - kTwoPi * floor((angle + 0.5 * kTwoPi) / kTwoPi);
  }

  Eigen::Vector3d measured_;
  Eigen::Matrix3d sqrt_information_;
};

/// Error of a relative spatial pose between poses given as two blocks each, position p (3) and unit
/// quaternion q (x y z w): L [q_a* (p_b − p_a) − p_m; 2 vec(q_m* q_a* q_b)], with LᵀL the
/// information matrix; 2 vec is the rotation vector to first order.
class Se3BetweenError {
 public:
  using Matrix6d = Eigen::Matrix<double, 6, 6>;

  Se3BetweenError(const Eigen::Vector3d& position, const Eigen::Quaterniond& rotation,
                  const Matrix6d& sqrt_information)
      : position_(position), rotation_(rotation), sqrt_information_(sqrt_information) {}

  template <typename T>
  bool operator()(const T* p_a, const T* q_a, const T* p_b, const T* q_b, T* residuals) const {
    using Vector3 = Eigen::Matrix<T, 3, 1>;
    const Eigen::Quaternion<T> a_inverse = Eigen::Map<const Eigen::Quaternion<T>>(q_a).conjugate();
    const Eigen::Quaternion<T> rotation = a_inverse * Eigen::Map<const Eigen::Quaternion<T>>(q_b);
    const Eigen::Quaternion<T> error = rotation_.conjugate().cast<T>() * rotation;
    const Vector3 position =
        a_inverse * (Eigen::Map<const Vector3>(p_b) - Eigen::Map<const Vector3>(p_a));
    Eigen::Matrix<T, 6, 1> stacked;
    stacked << position - position_.cast<T>(), T(2.0) * error.vec();
    Eigen::Map<Eigen::Matrix<T, 6, 1>> weighted(residuals);
    weighted = sqrt_information_.cast<T>() * stacked;
    return true;
  }

  static ceres::CostFunction* Create(const Eigen::Vector3d& position,
                                     const Eigen::Quaterniond& rotation,
                                     const Matrix6d& sqrt_information) {
    return new ceres::AutoDiffCostFunction<Se3BetweenError, 6, 3, 4, 3, 4>(
        new Se3BetweenError(position, rotation, sqrt_information));
  }

  EIGEN_MAKE_ALIGNED_OPERATOR_NEW

 private:
  Eigen::Vector3d position_;
  Eigen::Quaterniond rotation_;
  Matrix6d sqrt_information_;
};

}  // namespace inceres::tools
