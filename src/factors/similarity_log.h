#pragma once

#include <algorithm>
#include <cmath>

#include <Eigen/LU>

#include "factors/small_matrices.h"
#include "inceres/problem/rotation.h"

namespace inceres::internal {

/// The matrix of the exponential of Sim(3) and its derivatives: exp [y; r; λ] moves by V y, with
///
///     V(r, λ) = ∫₀¹ e^{λτ} Exp(τ r) dτ = A I + B [r]× + C [r]×²,
///     A = ∫ e^{λτ},  B = ∫ e^{λτ} τ sinc(τθ),  C = ∫ e^{λτ} τ² cosc(τθ),  θ = ‖r‖.
///
/// The integrands are entire, and their closed forms have four removable singularities; so they are
/// summed by Gauss's rule of ten points, which at |λ + iθ| below 5 leaves less than rounding, on as
/// many pieces of [0, 1] as that takes. Source: Strasdat, Montiel & Davison, "Scale drift-aware
/// large scale monocular SLAM", RSS 2010, section III.
class SimilarityLog {
 public:
  SimilarityLog(const Vector3& r, double lambda) : r_(r) {
    Integrate(r.squaredNorm(), lambda);
    V_inverse_ = Combine(A_, B_, C_).inverse();
  }

  /// V⁻¹: what makes a translation of it.
  const Matrix3& inverse() const { return V_inverse_; }

  /// ∂(V y)/∂r at a fixed y.
  Matrix3 DerivativeByRotation(const Vector3& y) const {
    const Vector3 once = r_.cross(y), twice = r_.cross(once);
    Matrix3 D = -B_ * Skew(y) + C_ * (r_ * y.transpose() - 2.0 * (y * r_.transpose()));
    D.diagonal().array() += C_ * r_.dot(y);
    return D + (B_slope_ * once + C_slope_ * twice) * r_.transpose();
  }
  /// ∂(V y)/∂λ at a fixed y.
  Vector3 DerivativeByScale(const Vector3& y) const {
    const Vector3 once = r_.cross(y);
    return A_lambda_ * y + B_lambda_ * once + C_lambda_ * r_.cross(once);
  }

 private:
  Matrix3 Combine(double a, double b, double c) const {
    const Matrix3 cross = Skew(r_);
    return a * Matrix3::Identity() + b * cross + c * (cross * cross);
  }

  // cosc'(x) / x from x² and the coefficients there: −1/12 at 0.
  static double SlopeOfCosc(double x_squared, const RotationCoefficients& k) {
    if (x_squared >= 0.25) {
      return (k.sinc - 2.0 * k.cosc) / x_squared;
    }
    const double t = x_squared;
    return -1.0 / 12.0 *
           (1.0 - t / 15.0 *
                      (1.0 - t / (112.0 / 3.0) *
                                 (1.0 - t / 67.5 * (1.0 - t / 105.6 * (1.0 - t / (455.0 / 3.0))))));
  }

  void Integrate(double theta_squared, double lambda) {
    // Nodes and weights on [−1, 1], by pairs.
    constexpr double kNodes[5] = {0.1488743389816312, 0.4333953941292472, 0.6794095682990244,
                                  0.8650633666889845, 0.9739065285171717};
    constexpr double kWeights[5] = {0.2955242247147529, 0.2692667193099964, 0.2190863625159820,
                                    0.1494513491505806, 0.0666713443086881};
    const int pieces = static_cast<int>(std::min(64.0, 1.0 + std::floor(std::fabs(lambda) / 3.0)));
    const double half = 0.5 / pieces;
    for (int piece = 0; piece < pieces; ++piece) {
      for (int k = 0; k < 10; ++k) {
        const double node = k % 2 == 0 ? kNodes[k / 2] : -kNodes[k / 2];
        const double tau = half * (2.0 * piece + 1.0 + node);
        Add(tau, half * kWeights[k / 2] * std::exp(lambda * tau), theta_squared);
      }
    }
  }

  void Add(double tau, double weight, double theta_squared) {
    const double x_squared = tau * tau * theta_squared;
    const RotationCoefficients k = CoefficientsOfAngle(x_squared);
    const double b = weight * tau * k.sinc, c = weight * tau * tau * k.cosc;
    const double tau_3 = weight * tau * tau * tau;
    A_ += weight;
    B_ += b;
    C_ += c;
    A_lambda_ += weight * tau;
    B_lambda_ += b * tau;
    C_lambda_ += c * tau;
    B_slope_ -= tau_3 * (k.cosc - k.sinq);  // sinc'(x)/x = −(cosc − sinq)
    C_slope_ += tau_3 * tau * SlopeOfCosc(x_squared, k);
  }

  Vector3 r_;
  Matrix3 V_inverse_;
  double A_ = 0.0, B_ = 0.0, C_ = 0.0;
  double A_lambda_ = 0.0, B_lambda_ = 0.0, C_lambda_ = 0.0;
  double B_slope_ = 0.0, C_slope_ = 0.0;  // ∂B/∂θ / θ, ∂C/∂θ / θ
};

}  // namespace inceres::internal
