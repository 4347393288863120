#pragma once

#include <vector>

#include <Eigen/Core>

#include "trust_region/linear_model.h"

namespace inceres::internal {

/// The model in the plane of the scaled gradient g̃ and the Gauss–Newton step: U (n × 2) an
/// orthonormal basis of it, and in its coordinates ½ xᵀB x + ĝᵀx with ĝ = Uᵀg̃, B = (J W⁻¹U)ᵀ(J
/// W⁻¹U). On the sphere ‖x‖ = R a minimum satisfies
///
///     (B + y I) x = −ĝ,    det(B + y I)² R² = ‖adj(B + y I) ĝ‖²,
///
/// the second a quartic in the multiplier y. Source: Byrd, Schnabel & Shultz, "Approximate solution
/// of the trust region problem by minimization over two-dimensional subspaces", 1988; which roots
/// are taken and when none is good enough: Ceres 2.1.
class DoglegSubspace {
 public:
  /// `w` is the metric of the Dog-Leg, so that g̃ = g/w and p = w δ. Costs three passes over J.
  /// False if both vectors are zero.
  bool Build(const std::vector<double>& w, const std::vector<double>& gradient,
             const std::vector<double>& gauss_newton, LinearModel* model);

  /// p := the minimum on the sphere of this radius, n entries; along −g̃ if the plane is but a
  /// line. False if no root of the quartic gives one: a traditional Dog-Leg step is due.
  bool MinimizeOnBoundary(double radius, const std::vector<double>& gradient, double* p) const;

 private:
  Eigen::Vector2d FindMinimum(double radius) const;

  bool one_dimensional_ = false;
  Eigen::MatrixX2d basis_;
  Eigen::Matrix2d B_;
  Eigen::Vector2d g_;
};

}  // namespace inceres::internal
