// The manifolds with a rotation in them.
#include <algorithm>
#include <cmath>

#include "inceres/problem/manifolds.h"
#include "inceres/problem/rotation.h"

// Three conventions: Ceres's quaternions, perturbed on the left by twice the angle ‖δ‖, in two
// storage orders; rotations perturbed on the right by a rotation vector, q ⊗ Exp(φ); and poses that
// combine the latter, or its left counterpart, with a position. Derivatives at δ = 0 are products
// of q with i, j and k, so they are exact at any q, of unit length or not: nothing normalizes, and
// x ⊞ 0 is x. Quaternions are copied before outputs are written, for Plus may be called with both
// the same.

namespace inceres {
namespace {

// Storage orders of a quaternion: position of x; y and z follow; position of w.
struct EigenOrder {
  static constexpr int x = 0, y = 1, z = 2, w = 3;
};
struct ScalarFirst {
  static constexpr int x = 1, y = 2, z = 3, w = 0;
};

// [cos‖δ‖, sinc(‖δ‖) δ] ⊗ q. Exp(2δ) is that quaternion.
// In Ceres δ is half of the rotation vector.
template <typename Order>
void PlusOnTheLeft(const double* q, const double* delta, double* q_plus_delta) {
  const double twice[3] = {2.0 * delta[0], 2.0 * delta[1], 2.0 * delta[2]};
  double step[4];
  ExpQuaternion(twice, step);
  // From either order into x, y, z, w, and back.
  const double from[4] = {q[Order::x], q[Order::y], q[Order::z], q[Order::w]};
  double to[4];
  MultiplyQuaternions(step, from, to);
  q_plus_delta[Order::x] = to[0];
  q_plus_delta[Order::y] = to[1];
  q_plus_delta[Order::z] = to[2];
  q_plus_delta[Order::w] = to[3];
}

// (0, δ) ⊗ q, column by column.
template <typename Order>
void PlusJacobianOnTheLeft(const double* q, double* jacobian) {
  const double x = q[Order::x], y = q[Order::y], z = q[Order::z], w = q[Order::w];
  // Row by row of the result: δ_x, δ_y, δ_z times q's entries.
  const double rows[4][3] = {{w, z, -y}, {-z, w, x}, {y, -x, w}, {-x, -y, -z}};
  std::copy_n(rows[0], 3, jacobian + 3 * Order::x);
  std::copy_n(rows[1], 3, jacobian + 3 * Order::y);
  std::copy_n(rows[2], 3, jacobian + 3 * Order::z);
  std::copy_n(rows[3], 3, jacobian + 3 * Order::w);
}

// ½ Log(p ⊗ q⁻¹): the inverse of PlusOnTheLeft.
template <typename Order>
void MinusOnTheLeft(const double* p, const double* q, double* delta) {
  const double to[4] = {p[Order::x], p[Order::y], p[Order::z], p[Order::w]};
  // Conjugate: the inverse of a unit quaternion. Log takes q and −q to the same vector.
  const double from_inverse[4] = {-q[Order::x], -q[Order::y], -q[Order::z], q[Order::w]};
  double step[4];
  MultiplyQuaternions(to, from_inverse, step);
  LogQuaternion(step, delta);
  for (int k = 0; k < 3; ++k) {
    delta[k] *= 0.5;
  }
}

// q ⊗ Exp(φ), x, y, z, w.
void PlusOnTheRight(const double* q, const double* phi, double* q_plus_phi) {
  double step[4];
  double to[4];
  ExpQuaternion(phi, step);
  MultiplyQuaternions(q, step, to);
  std::copy_n(to, 4, q_plus_phi);
}

// Log(q⁻¹ ⊗ p), x, y, z, w.
void MinusOnTheRight(const double* p, const double* q, double* phi) {
  const double q_inverse[4] = {-q[0], -q[1], -q[2], q[3]};
  double step[4];
  MultiplyQuaternions(q_inverse, p, step);
  LogQuaternion(step, phi);
}

// q ⊗ (φ/2, 0), column by column; rows of the result are row_stride apart.
void PlusJacobianOnTheRight(const double* q, double* jacobian, int row_stride) {
  // Half of q, since Exp(φ) begins with φ/2.
  const double x = 0.5 * q[0], y = 0.5 * q[1], z = 0.5 * q[2], w = 0.5 * q[3];
  const double rows[4][3] = {{w, -z, y}, {z, w, -x}, {-y, x, w}, {-x, -y, -z}};
  for (int r = 0; r < 4; ++r) {
    std::copy_n(rows[r], 3, jacobian + r * row_stride);
  }
}

}  // namespace

// Storage w, x, y, z.
bool QuaternionManifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  PlusOnTheLeft<ScalarFirst>(x, delta, x_plus_delta);
  return true;
}

bool QuaternionManifold::PlusJacobian(const double* x, double* jacobian) const {
  PlusJacobianOnTheLeft<ScalarFirst>(x, jacobian);
  return true;
}

bool QuaternionManifold::Minus(const double* y, const double* x, double* delta) const {
  MinusOnTheLeft<ScalarFirst>(y, x, delta);
  return true;
}

// The same with storage x, y, z, w.
bool EigenQuaternionManifold::Plus(const double* x, const double* delta,
                                   double* x_plus_delta) const {
  PlusOnTheLeft<EigenOrder>(x, delta, x_plus_delta);
  return true;
}

bool EigenQuaternionManifold::PlusJacobian(const double* x, double* jacobian) const {
  PlusJacobianOnTheLeft<EigenOrder>(x, jacobian);
  return true;
}

bool EigenQuaternionManifold::Minus(const double* y, const double* x, double* delta) const {
  MinusOnTheLeft<EigenOrder>(y, x, delta);
  return true;
}

// Storage x, y, z, w, perturbed on the right.
bool RotationQuaternionManifold::Plus(const double* x, const double* delta,
                                      double* x_plus_delta) const {
  PlusOnTheRight(x, delta, x_plus_delta);
  return true;
}

bool RotationQuaternionManifold::PlusJacobian(const double* x, double* jacobian) const {
  PlusJacobianOnTheRight(x, jacobian, 3);
  return true;
}

bool RotationQuaternionManifold::Minus(const double* y, const double* x, double* delta) const {
  MinusOnTheRight(y, x, delta);
  return true;
}

// The position is added as it is, in the world, not turned: SO(3) × R³, not SE(3).
bool PoseManifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  for (int k = 0; k < 3; ++k) {
    x_plus_delta[k] = x[k] + delta[k];
  }
  PlusOnTheRight(x + 3, delta + 3, x_plus_delta + 3);
  return true;
}

bool PoseManifold::PlusJacobian(const double* x, double* jacobian) const {
  std::fill_n(jacobian, 42, 0.0);
  for (int k = 0; k < 3; ++k) {
    // Rows 0 to 2 and columns 0 to 2 of a 7×6 matrix.
    jacobian[7 * k] = 1.0;
  }
  // From row 3 and column 3 on: φ moves the quaternion.
  PlusJacobianOnTheRight(x + 3, jacobian + 3 * 6 + 3, 6);
  return true;
}

bool PoseManifold::Minus(const double* y, const double* x, double* delta) const {
  for (int k = 0; k < 3; ++k) {
    delta[k] = y[k] - x[k];
  }
  MinusOnTheRight(y + 3, x + 3, delta + 3);
  return true;
}

// Position and rotation are both perturbed in the world's axes.
bool LeftPoseManifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  for (int k = 0; k < 3; ++k) {
    x_plus_delta[k] = x[k] + delta[k];
  }
  // PlusOnTheLeft doubles what it is given: half of φ makes it Exp(φ) ⊗ q.
  const double half[3] = {0.5 * delta[3], 0.5 * delta[4], 0.5 * delta[5]};
  PlusOnTheLeft<EigenOrder>(x + 3, half, x_plus_delta + 3);
  return true;
}

bool LeftPoseManifold::PlusJacobian(const double* x, double* jacobian) const {
  double of_q[12];
  PlusJacobianOnTheLeft<EigenOrder>(x + 3, of_q);
  std::fill_n(jacobian, 42, 0.0);
  for (int k = 0; k < 3; ++k) {
    jacobian[7 * k] = 1.0;
  }
  for (int k = 0; k < 12; ++k) {
    // The same half in the derivative.
    jacobian[(3 + k / 3) * 6 + 3 + k % 3] = 0.5 * of_q[k];
  }
  return true;
}

// Position and rotation are independent of one another, as in PoseManifold.
bool LeftPoseManifold::Minus(const double* y, const double* x, double* delta) const {
  for (int k = 0; k < 3; ++k) {
    delta[k] = y[k] - x[k];
  }
  MinusOnTheLeft<EigenOrder>(y + 3, x + 3, delta + 3);
  // MinusOnTheLeft halves: twice that is the rotation vector.
  for (int k = 3; k < 6; ++k) {
    delta[k] *= 2.0;
  }
  return true;
}

// T Exp(ξ) with Exp(ξ) = (Exp(φ), J_l(φ) ρ): the translation follows a screw motion, not a straight
// line.
bool SE3Manifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  const double* phi = delta + 3;
  const RotationCoefficients k =
      CoefficientsOfAngle(phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]);
  double J_l[9];
  double R[9];
  double moved[3];
  double turned[3];
  // J_l has the coefficients of Exp shifted by one; no inverse, no cancellation at small angles.
  RotationPolynomial(phi, k.cosc, k.sinq, J_l);
  QuaternionToMatrix(x + 3, R);
  MultiplyMatrixVector(J_l, delta, moved);
  MultiplyMatrixVector(R, moved, turned);
  for (int i = 0; i < 3; ++i) {
    x_plus_delta[i] = x[i] + turned[i];
  }
  PlusOnTheRight(x + 3, phi, x_plus_delta + 3);
  return true;
}

bool SE3Manifold::PlusJacobian(const double* x, double* jacobian) const {
  // At ξ = 0 J_l = I, so the position moves by R ρ.
  std::fill_n(jacobian, 42, 0.0);
  double R[9];
  QuaternionToMatrix(x + 3, R);
  for (int r = 0; r < 3; ++r) {
    std::copy_n(R + 3 * r, 3, jacobian + 6 * r);
  }
  PlusJacobianOnTheRight(x + 3, jacobian + 3 * 6 + 3, 6);
  return true;
}

bool SE3Manifold::Minus(const double* y, const double* x, double* delta) const {
  // φ first: J_l⁻¹ of it is needed for ρ.
  double* phi = delta + 3;
  MinusOnTheRight(y + 3, x + 3, phi);
  double J_l_inv[9];
  double R_inv[9];
  // J_l⁻¹ exists below 2π, and Log is at most π.
  RotationPolynomial(phi, -0.5, InverseLeftJacobianCoefficient(phi), J_l_inv);
  const double q_inverse[4] = {-x[3], -x[4], -x[5], x[6]};
  QuaternionToMatrix(q_inverse, R_inv);
  const double moved[3] = {y[0] - x[0], y[1] - x[1], y[2] - x[2]};
  double turned_back[3];
  MultiplyMatrixVector(R_inv, moved, turned_back);
  MultiplyMatrixVector(J_l_inv, turned_back, delta);
  return true;
}

// The planar motion: J_l becomes V(ω), a rotation times a length.
bool SE2Manifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  const double omega = delta[2];
  // sin ω / ω and (1 − cos ω)/ω = sin(ω/2) · sinc(ω/2), both without cancellation.
  const double a = Sinc(omega * omega, omega);
  const double b = std::sin(0.5 * omega) * Sinc(0.25 * omega * omega, 0.5 * omega);
  const double moved[2] = {a * delta[0] - b * delta[1], b * delta[0] + a * delta[1]};
  const double c = std::cos(x[2]);
  const double s = std::sin(x[2]);
  // Not wrapped: angles may be any number of turns apart, and ⊟ gives the difference as it is.
  const double theta = x[2] + omega;
  x_plus_delta[0] = x[0] + c * moved[0] - s * moved[1];
  x_plus_delta[1] = x[1] + s * moved[0] + c * moved[1];
  x_plus_delta[2] = theta;
  return true;
}

bool SE2Manifold::PlusJacobian(const double* x, double* jacobian) const {
  const double c = std::cos(x[2]);
  const double s = std::sin(x[2]);
  const double rows[9] = {c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0};
  std::copy_n(rows, 9, jacobian);
  return true;
}

bool SE2Manifold::Minus(const double* y, const double* x, double* delta) const {
  const double omega = y[2] - x[2];
  const double a = Sinc(omega * omega, omega);
  const double b = std::sin(0.5 * omega) * Sinc(0.25 * omega * omega, 0.5 * omega);
  // V(ω) = [a, −b; b, a], whose inverse is its transpose over the determinant.
  const double determinant = a * a + b * b;  // of V(ω): zero after a full turn, but for rounding
  // Below it δ would be a million million times as long as the way, and of wrong digits.
  constexpr double kSingular = 1e-24;
  const double c = std::cos(x[2]);
  const double s = std::sin(x[2]);
  const double turned_back[2] = {c * (y[0] - x[0]) + s * (y[1] - x[1]),
                                 c * (y[1] - x[1]) - s * (y[0] - x[0])};
  delta[0] = (a * turned_back[0] + b * turned_back[1]) / determinant;
  delta[1] = (a * turned_back[1] - b * turned_back[0]) / determinant;
  delta[2] = omega;
  return determinant >= kSingular;
}

}  // namespace inceres
