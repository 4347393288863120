#include "inceres/factors/relative_pose.h"

#include <cstddef>

#include "factors/pose_slot.h"
#include "factors/whiten.h"
#include "inceres/problem/rotation.h"

// A measured relative pose of two cameras, a loop closure for instance: rotation residual Log(E)
// with E = R_aᵀ R_b R_abᵀ and position residual R_bᵀ (p_a − p_b) − p_ab, in b's axes. E is formed
// from quaternions, whose Log is accurate at every angle, and J_l⁻¹(r) makes the derivatives exact
// for large residuals as well: loop closures begin far from their minimum. Smooth below an angle of
// π.

namespace inceres {
namespace {

using internal::MultiplyTransposed;

// The residual before whitening and what the Jacobians share with it.
struct Difference {
  double R_b[9];
  double t[3];  // R_bᵀ (p_a − p_b)
  double e[6];  // [Log(R_aᵀ R_b R_abᵀ); t − p_ab]
};

void Compare(const RelativePoseFamily::Measurement& measurement, const double* a, const double* b,
             Difference& v) {
  // The order of multiplication is that of E: a⁻¹ b, then the measured inverse from the right.
  double q_a_conjugate[4], q_ab_conjugate[4], q[4], error[4];
  ConjugateQuaternion(a + 3, q_a_conjugate);
  ConjugateQuaternion(measurement.q_ab, q_ab_conjugate);
  MultiplyQuaternions(q_a_conjugate, b + 3, q);
  MultiplyQuaternions(q, q_ab_conjugate, error);
  LogQuaternion(error, v.e);
  const double baseline[3] = {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
  // b's axes: the position error is where b sees a, so p_b and R_b both move it.
  QuaternionToMatrix(b + 3, v.R_b);
  MultiplyTransposed(v.R_b, baseline, v.t);
  for (int k = 0; k < 3; ++k) {
    v.e[3 + k] = v.t[k] - measurement.p_ab[k];
  }
}

// With right perturbations R Exp(φ) the rotation error E = R_aᵀ R_b R_abᵀ becomes Exp(−φ_a) E and E
// Exp(R_ab φ_b), so with r = Log E:
//     ∂r/∂φ_a = −J_l⁻¹(r),        ∂r/∂φ_b = J_r⁻¹(r) R_ab = J_l⁻¹(−r) R_ab,
//     ∂t/∂p_a = R_bᵀ = −∂t/∂p_b,  ∂t/∂φ_b = [t]×.
void DifferentiateA(const Difference& v, double E[6][6]) {
  double J_l_inverse[9];
  RotationPolynomial(v.e, -0.5, InverseLeftJacobianCoefficient(v.e), J_l_inverse);
  for (int r = 0; r < 3; ++r) {
    // Rows 0 to 2 are rotation, 3 to 5 position; columns 0 to 2 are δp, 3 to 5 are φ. a moves the
    // position only by δp_a: t has no R_a.
    for (int c = 0; c < 3; ++c) {
      E[r][3 + c] = -J_l_inverse[3 * r + c];
      E[3 + r][c] = v.R_b[3 * c + r];
    }
  }
}

void DifferentiateB(const Difference& v, const double* q_ab, double E[6][6]) {
  double R_ab[9], J_r_inverse[9];
  // r does not depend on positions, so the upper left block stays zero.
  QuaternionToMatrix(q_ab, R_ab);
  RotationPolynomial(v.e, 0.5, InverseLeftJacobianCoefficient(v.e), J_r_inverse);
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) {
      for (int k = 0; k < 3; ++k) {
        E[r][3 + c] += J_r_inverse[3 * r + k] * R_ab[3 * k + c];
      }
      E[3 + r][c] = -v.R_b[3 * c + r];
    }
  }
  // [t]× by φ_b: R_b Exp(φ_b) turns t by −φ_b.
  E[3][4] = -v.t[2];
  E[3][5] = v.t[1];
  E[4][3] = v.t[2];
  E[4][5] = -v.t[0];
  E[5][3] = -v.t[1];
  E[5][4] = v.t[0];
}

}  // namespace

EvaluationFailure RelativePoseFamily::Evaluate(const FactorBatch& batch) const {
  return internal::EvaluateEach(batch, [&](int i) {
    const Measurement& m = measurement(i);
    const double* const* parameters = batch.parameters + 2 * static_cast<std::ptrdiff_t>(i);
    Difference v;
    Compare(m, parameters[0], parameters[1], v);
    const auto differentiate = [&](int slot, double E[6][6]) {
      if (slot == 0) {
        DifferentiateA(v, E);
      } else {
        DifferentiateB(v, m.q_ab, E);
      }
    };
    return internal::WritePoseFactor(batch, i, 2, m.sqrt_information, v.e, false, differentiate);
  });
}

}  // namespace inceres
