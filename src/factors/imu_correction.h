#pragma once

#include "factors/imu_math.h"
#include "inceres/factors/imu_preintegrator.h"

namespace inceres::internal {

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

}  // namespace inceres::internal
