#pragma once

#include "factors/small_matrices.h"
#include "inceres/problem/rotation.h"

namespace inceres::internal {

/// What the errors of a measured relative pose are made of, with E = R_mᵀ R_aᵀ R_b.
struct RelativeError {
  Matrix3 R_a;
  Matrix3 R_m;
  Vector3 t;            // R_aᵀ (p_b − p_a) / s_a
  Vector3 u;            // t − p_m
  double q[4];          // E, of w ≥ 0
  Vector3 r;            // Log E
  Matrix3 J_l_inverse;  // at r

  Vector3 epsilon() const { return {q[0], q[1], q[2]}; }
};

/// Everything that error and Jacobians share, computed once a factor, of poses a and b; s_a is a's
/// scale if it has one. Rotations by quaternions, for Log takes one and needs no angle from a
/// matrix; vectors by matrices, which the derivatives need as well.
inline RelativeError MeasureRelative(const double* p_m, const double* q_m, const double* a,
                                     const double* b, double s_a = 1.0) {
  RelativeError e;
  double a_inverse[4], m_inverse[4], q_ab[4];
  ConjugateQuaternion(a + 3, a_inverse);
  ConjugateQuaternion(q_m, m_inverse);
  MultiplyQuaternions(a_inverse, b + 3, q_ab);
  MultiplyQuaternions(m_inverse, q_ab, e.q);
  // q and −q are one rotation; the one of w ≥ 0 has an angle of at most π.
  if (e.q[3] < 0.0) {
    for (double& value : e.q) {
      value = -value;
    }
  }
  e.R_a = RotationOf(a + 3);
  e.R_m = RotationOf(q_m);
  e.t = e.R_a.transpose() * Vector3(b[0] - a[0], b[1] - a[1], b[2] - a[2]) / s_a;
  e.u = e.t - AsVector(p_m);
  LogQuaternion(e.q, e.r.data());
  // J_l⁻¹(r) = I − ½ [r]× + k [r]×²; J_r⁻¹ is its transpose.
  RotationPolynomial(e.r.data(), -0.5, InverseLeftJacobianCoefficient(e.r.data()),
                     e.J_l_inverse.data());
  return e;
}

}  // namespace inceres::internal
