#pragma once

#include "factors/small_matrices.h"
#include "inceres/factors/imu_preintegrator.h"
#include "inceres/problem/rotation.h"

namespace inceres::internal {

/// J_r with Exp(φ + δ) ≈ Exp(φ) Exp(J_r(φ) δ).
inline Matrix3 RightJacobian(const Vector3& phi) {
  const RotationCoefficients k = CoefficientsOfAngle(phi.squaredNorm());
  Matrix3 J;
  RotationPolynomial(phi.data(), -k.cosc, k.sinq, J.data());
  return J;
}

/// How the parts of a preintegrated motion stand in ImuDelta: errors (φ, v, p), then the biases.
inline constexpr int kDeltaPhi = 0, kDeltaV = 3, kDeltaP = 6, kDeltaGyrBias = 9, kDeltaAccBias = 12;

/// Where the conventions put the parts of a residual, and the biases of a speed-bias variable
/// (velocity first).
struct ImuLayout {
  int rotation, position, velocity, gyr_bias, acc_bias;  // first row of each
  int gyr_column, acc_column;                            // first column of each bias, 3 or 6
};

ImuLayout LayoutOf(const ImuConventions& conventions);

/// e_there = C e_here, a permutation of parts whose rotation is turned by R: from (φ, v, p, b_g,
/// b_a) to the rows given.
Matrix<15, 15> PartMap(const ImuLayout& rows, const Matrix3& R);

/// The places of a state's tangent: pose (δp, φ), then the speed-bias.
ImuLayout StateLayoutOf(const ImuConventions& conventions);

/// A preintegrated motion, corrected to first order for other biases than those it was integrated
/// at; and its derivative there.
struct CorrectedDelta {
  double q[4];
  Vector3 v;
  Vector3 p;
  Matrix3 phi_gyr_bias;  // ∂φ/∂b_g, with ΔR Exp(φ): J_r(θ) ∂φ̄/∂b_g at the correction θ
  Matrix<6, 6> motion_bias;  // ∂(v, p)/∂(b_g, b_a)
};

/// ΔR = ΔR̄ Exp(θ), θ = ∂φ̄/∂b_g δb_g;  (Δv, Δp) = (Δv̄, Δp̄) + ∂(v, p)/∂b δb. The derivatives are
/// left out unless asked for.
inline CorrectedDelta Correct(const ImuDelta& delta, const double* gyr_bias, const double* acc_bias,
                              bool jacobians) {
  const Eigen::Map<const Matrix<9, 6>> J(delta.bias_jacobian);
  Matrix<6, 1> change;
  change << AsVector(gyr_bias) - AsVector(delta.gyr_bias),
      AsVector(acc_bias) - AsVector(delta.acc_bias);
  const Vector3 theta = J.topLeftCorner<3, 3>() * change.head<3>();
  double turn[4];
  ExpQuaternion(theta.data(), turn);
  CorrectedDelta corrected;
  MultiplyQuaternions(delta.q, turn, corrected.q);
  corrected.v = AsVector(delta.v) + J.middleRows<3>(kDeltaV) * change;
  corrected.p = AsVector(delta.p) + J.middleRows<3>(kDeltaP) * change;
  if (jacobians) {
    corrected.phi_gyr_bias = RightJacobian(theta) * J.topLeftCorner<3, 3>();
    corrected.motion_bias = J.bottomRows<6>();
  }
  return corrected;
}

/// Adds the interval between two samples to what was integrated: motion, covariance, derivative
/// with respect to the biases.
void StepImu(const ImuOptions& options, const ImuSample& from, const ImuSample& to,
             ImuDelta* delta);

}  // namespace inceres::internal
