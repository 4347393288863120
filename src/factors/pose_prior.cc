#include "inceres/factors/pose_prior.h"

#include <algorithm>
#include <cassert>
#include <cmath>

#include "factors/pose_slot.h"
#include "factors/whiten.h"
#include "inceres/problem/rotation.h"

// Priors on the state of a frame. Of a pose: e = [p − p_0; Log E] with E = R_0ᵀ R on PoseManifold,
// or E = R R_0ᵀ on LeftPoseManifold: the perturbation then stands next to E on the side on which it
// acts, and the derivative is the inverse Jacobian of that side with no rotation in between. Of
// velocity and biases: plain differences. Both are whitened by an upper triangular U.

namespace inceres {

using internal::MultiplyUpper;

namespace {

// With r = Log E: E Exp(φ) on the right moves it by J_r⁻¹(r) φ, Exp(φ) E on the left by J_l⁻¹(r) φ.
void Compare(const double* pose, const double* prior, bool left, double e[6]) {
  double back[4], error[4];
  ConjugateQuaternion(prior + 3, back);
  // The prior's inverse stands on the side that is not perturbed.
  if (left) {
    MultiplyQuaternions(pose + 3, back, error);
  } else {
    MultiplyQuaternions(back, pose + 3, error);
  }
  for (int k = 0; k < 3; ++k) {
    e[k] = pose[k] - prior[k];
  }
  LogQuaternion(error, e + 3);
}

// The position is perturbed by addition, so its block is the identity, and position and rotation do
// not mix.
void Differentiate(const double e[6], bool left, double E[36]) {
  double J_inverse[9];
  // J_l⁻¹ = I − ½ [r]× + k [r]×²; J_r⁻¹ differs in the sign of the middle term. Both fail at an
  // angle of 2π, which Log never reaches.
  RotationPolynomial(e + 3, left ? -0.5 : 0.5, InverseLeftJacobianCoefficient(e + 3), J_inverse);
  std::fill_n(E, 36, 0.0);
  // Rows and columns 0 to 2 are the position, 3 to 5 the rotation.
  for (int r = 0; r < 3; ++r) {
    E[7 * r] = 1.0;
    std::copy_n(J_inverse + 3 * r, 3, E + 6 * (3 + r) + 3);
  }
}

}  // namespace

EvaluationFailure PosePriorFamily::Evaluate(const FactorBatch& batch) const {
  const bool left = side_ == Side::kLeft;
  for (int i = batch.begin; i < batch.end; ++i) {
    const Measurement& measurement = this->measurement(i);
    double e[6];
    Compare(batch.parameters[i], measurement.pose, left, e);
    double* residual = batch.residuals + 6 * static_cast<std::ptrdiff_t>(i);
    if (!std::isfinite(MultiplyUpper<6, 1>(measurement.sqrt_information, e, residual, 1))) {
      return {i, "a residual is not finite"};
    }
    if (batch.jacobians != nullptr && batch.tangent_maps[i]->wanted()) {
      internal::AssertPoseManifold(*batch.tangent_maps[i], batch.parameters[i], left);
      double E[36];
      Differentiate(e, left, E);
      const JacobianView& view = batch.jacobians[0];
      // Checked along with writing: U J has an entry that is not finite if J has one.
      if (!std::isfinite(MultiplyUpper<6, 6>(measurement.sqrt_information, E,
                                             view.data + i * view.factor_stride,
                                             view.row_stride))) {
        return {i, "a Jacobian entry is not finite"};
      }
    }
  }
  return {};
}

// Velocity and biases with a full U, where DiagonalPriorFamily has a diagonal one. The order of the
// biases is that of the variable: mean and U come in the same.
EvaluationFailure SpeedBiasPriorFamily::Evaluate(const FactorBatch& batch) const {
  for (int i = batch.begin; i < batch.end; ++i) {
    const Measurement& measurement = this->measurement(i);
    double e[9];
    for (int k = 0; k < 9; ++k) {
      e[k] = batch.parameters[i][k] - measurement.speed_bias[k];
    }
    double* residual = batch.residuals + 9 * static_cast<std::ptrdiff_t>(i);
    if (!std::isfinite(MultiplyUpper<9, 1>(measurement.sqrt_information, e, residual, 1))) {
      return {i, "a residual is not finite"};
    }
    if (batch.jacobians != nullptr && batch.tangent_maps[i]->wanted()) {
      // A Euclidean variable: the Jacobian is U itself, whatever the values are. Below its diagonal
      // it is zero, as MultiplyUpper has it.
      assert(batch.tangent_maps[i]->kind == TangentMap::Kind::kIdentity);
      const JacobianView& view = batch.jacobians[0];
      for (int r = 0; r < 9; ++r) {
        double* const row = view.data + i * view.factor_stride + r * view.row_stride;
        std::fill_n(row, r, 0.0);
        std::copy_n(measurement.sqrt_information + 10 * r, 9 - r, row + r);
      }
    }
  }
  return {};
}

}  // namespace inceres
