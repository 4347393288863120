#include "inceres/factors/pose_prior.h"

#include <algorithm>
#include <cassert>

#include "factors/pose_slot.h"
#include "factors/whiten.h"
#include "inceres/problem/rotation.h"

// Priors on the state of a frame. Of a pose: e = [p − p_0; Log E] with E = R_0ᵀ R on PoseManifold,
// or E = R R_0ᵀ on LeftPoseManifold: the perturbation then stands next to E on the side on which it
// acts, and the derivative is the inverse Jacobian of that side with no rotation in between. Of
// velocity and biases: plain differences. Both are whitened by an upper triangular U.

namespace inceres {

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
void Differentiate(const double e[6], bool left, double E[6][6]) {
  double J_inverse[9];
  // J_l⁻¹ = I − ½ [r]× + k [r]×²; J_r⁻¹ differs in the sign of the middle term. Both fail at an
  // angle of 2π, which Log never reaches.
  RotationPolynomial(e + 3, left ? -0.5 : 0.5, InverseLeftJacobianCoefficient(e + 3), J_inverse);
  // Rows and columns 0 to 2 are the position, 3 to 5 the rotation.
  for (int r = 0; r < 3; ++r) {
    E[r][r] = 1.0;
    std::copy_n(J_inverse + 3 * r, 3, E[3 + r] + 3);
  }
}

}  // namespace

EvaluationFailure PosePriorFamily::Evaluate(const FactorBatch& batch) const {
  const bool left = side_ == Side::kLeft;
  return internal::EvaluateEach(batch, [&](int i) {
    const Measurement& m = measurement(i);
    double e[6];
    Compare(batch.parameters[i], m.pose, left, e);
    return internal::WritePoseFactor(
        batch, i, 1, m.sqrt_information, e, left,
        [&](int /*slot*/, double E[6][6]) { Differentiate(e, left, E); });
  });
}

// Velocity and biases with a full U, where DiagonalPriorFamily has a diagonal one. The order of the
// biases is that of the variable: mean and U come in the same.
EvaluationFailure SpeedBiasPriorFamily::Evaluate(const FactorBatch& batch) const {
  return internal::EvaluateEach(batch, [&](int i) {
    const Measurement& m = measurement(i);
    double e[9];
    for (int k = 0; k < 9; ++k) {
      e[k] = batch.parameters[i][k] - m.speed_bias[k];
    }
    const auto write_slot = [&](int /*slot*/, const TangentMap& map, const double* /*values*/) {
      // A Euclidean variable: the Jacobian is U itself, whatever the values are. Below its diagonal
      // it is zero, as MultiplyUpper has it.
      assert(map.kind == TangentMap::Kind::kIdentity);
      static_cast<void>(map);
      const JacobianView& view = batch.jacobians[0];
      for (int r = 0; r < 9; ++r) {
        double* const row = view.data + i * view.factor_stride + r * view.row_stride;
        std::fill_n(row, r, 0.0);
        std::copy_n(m.sqrt_information + 10 * r, 9 - r, row + r);
      }
      return 0.0;
    };
    return internal::WriteFactor<9>(batch, i, 1, m.sqrt_information, e, write_slot);
  });
}

}  // namespace inceres
