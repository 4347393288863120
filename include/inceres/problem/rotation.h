#pragma once

#include <cmath>

namespace inceres {

/// Rotations as plain arrays: a rotation vector φ (3, radians), a unit Hamilton quaternion stored
/// x, y, z, w (Eigen's layout), a row-major 3×3 matrix. All functions are closed forms with a
/// Taylor branch near zero, allocate nothing and are pure. Source: Sola, Deray & Atchuthan, "A
/// micro Lie theory for state estimation in robotics", 2018, appendices A and B.

/// The scalars of the closed forms at angle θ = ‖φ‖:
///     Exp(φ)  = I + sinc·[φ]× + cosc·[φ]×²        (rotation matrix)
///     J_l(φ)  = I + cosc·[φ]× + sinq·[φ]×²        (left Jacobian; J_r(φ) = J_l(−φ))
struct RotationCoefficients {
  double sinc;  ///< sin θ / θ
  double cosc;  ///< (1 − cos θ) / θ²
  double sinq;  ///< (θ − sin θ) / θ³
};

/// sin θ / θ from θ² and θ; the series keeps the smallest angles, whose square underflows, exact.
inline double Sinc(double theta_squared, double theta) {
  return theta_squared < 1e-8
             ? 1.0 - theta_squared * (1.0 / 6.0) * (1.0 - theta_squared * (1.0 / 20.0))
             : std::sin(theta) / theta;
}

/// The coefficients at θ, from θ²; by series where a closed form would lose digits.
inline RotationCoefficients CoefficientsOfAngle(double theta_squared) {
  if (theta_squared < 0.25) {
    // θ − sin θ would lose digits here. The first term left out is below 1e-16 of the sum.
    const double t = theta_squared;
    return {
        1.0 - t / 6.0 *
                  (1.0 -
                   t / 20.0 *
                       (1.0 - t / 42.0 * (1.0 - t / 72.0 * (1.0 - t / 110.0 * (1.0 - t / 156.0))))),
        0.5 *
            (1.0 -
             t / 12.0 *
                 (1.0 -
                  t / 30.0 *
                      (1.0 - t / 56.0 * (1.0 - t / 90.0 * (1.0 - t / 132.0 * (1.0 - t / 182.0)))))),
        1.0 / 6.0 *
            (1.0 -
             t / 20.0 *
                 (1.0 - t / 42.0 * (1.0 - t / 72.0 * (1.0 - t / 110.0 * (1.0 - t / 156.0)))))};
  }
  const double theta = std::sqrt(theta_squared);
  // Half angles: 1 − cos θ = 2 sin²(θ/2) does not cancel near multiples of 2π.
  const double sin_half = std::sin(0.5 * theta);
  const double sin_theta = 2.0 * sin_half * std::cos(0.5 * theta);
  return {sin_theta / theta, 2.0 * sin_half * sin_half / theta_squared,
          (theta - sin_theta) / (theta_squared * theta)};
}

/// M = I + a·[φ]× + b·[φ]×², row-major: the rotation matrix for (sinc, cosc), the left Jacobian for
/// (cosc, sinq).
inline void RotationPolynomial(const double phi[3], double a, double b, double M[9]) {
  const double x = phi[0], y = phi[1], z = phi[2];
  const double bxy = b * x * y, bxz = b * x * z, byz = b * y * z;
  M[0] = 1.0 - b * (y * y + z * z);
  M[1] = bxy - a * z;
  M[2] = bxz + a * y;
  M[3] = bxy + a * z;
  M[4] = 1.0 - b * (x * x + z * z);
  M[5] = byz - a * x;
  M[6] = bxz - a * y;
  M[7] = byz + a * x;
  M[8] = 1.0 - b * (x * x + y * y);
}

/// The scalar c of the inverse left Jacobian J_l⁻¹(φ) = I − ½[φ]× + c·[φ]×², at ‖φ‖ < 2π; J_r⁻¹(φ)
/// = J_l⁻¹(−φ):
///     c = (1 − (θ/2) cot(θ/2)) / θ².
inline double InverseLeftJacobianCoefficient(const double phi[3]) {
  const double t = phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2];
  if (t < 0.01) {
    // The first term left out is below 1e-18 of the sum.
    return 1.0 / 12.0 *
           (1.0 + t / 60.0 * (1.0 + t / 42.0 * (1.0 + t / 40.0 * (1.0 + t * (5.0 / 198.0)))));
  }
  const double half = 0.5 * std::sqrt(t);
  return (1.0 - half * std::cos(half) / std::sin(half)) / t;
}

/// c = a × b. c must not alias.
inline void Cross(const double a[3], const double b[3], double c[3]) {
  c[0] = a[1] * b[2] - a[2] * b[1];
  c[1] = a[2] * b[0] - a[0] * b[2];
  c[2] = a[0] * b[1] - a[1] * b[0];
}

/// q = Exp(φ), x, y, z, w: a turn by ‖φ‖ about φ.
inline void ExpQuaternion(const double phi[3], double q[4]) {
  const double theta_squared = phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2];
  const double half = 0.5 * std::sqrt(theta_squared);
  const double scale = 0.5 * Sinc(0.25 * theta_squared, half);
  q[0] = scale * phi[0];
  q[1] = scale * phi[1];
  q[2] = scale * phi[2];
  q[3] = std::cos(half);
}

/// φ = Log(q) with ‖φ‖ ≤ π. q and −q give the same φ (up to rounding at exactly π).
inline void LogQuaternion(const double q[4], double phi[3]) {
  const double sine = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2]);
  const double sign = q[3] < 0.0 ? -1.0 : 1.0;
  const double cosine = sign * q[3];
  // atan2 is accurate at every angle, where acos(w) loses half the digits near zero and asin near
  // π.
  const double scale =
      sine < 1e-100 ? 2.0 * sign / cosine : 2.0 * sign * std::atan2(sine, cosine) / sine;
  for (int k = 0; k < 3; ++k) {
    phi[k] = scale * q[k];
  }
}

/// c = a ⊗ b (Hamilton), x, y, z, w. c must not alias.
inline void MultiplyQuaternions(const double a[4], const double b[4], double c[4]) {
  c[0] = a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1];
  c[1] = a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0];
  c[2] = a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3];
  c[3] = a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2];
}

/// The inverse of a unit quaternion x, y, z, w. conjugate may be q.
inline void ConjugateQuaternion(const double q[4], double conjugate[4]) {
  conjugate[0] = -q[0];
  conjugate[1] = -q[1];
  conjugate[2] = -q[2];
  conjugate[3] = q[3];
}

/// The rotation matrix of a unit quaternion x, y, z, w; row-major.
inline void QuaternionToMatrix(const double q[4], double R[9]) {
  const double x = q[0], y = q[1], z = q[2], w = q[3];
  R[0] = 1.0 - 2.0 * (y * y + z * z);
  R[1] = 2.0 * (x * y - w * z);
  R[2] = 2.0 * (x * z + w * y);
  R[3] = 2.0 * (x * y + w * z);
  R[4] = 1.0 - 2.0 * (x * x + z * z);
  R[5] = 2.0 * (y * z - w * x);
  R[6] = 2.0 * (x * z - w * y);
  R[7] = 2.0 * (y * z + w * x);
  R[8] = 1.0 - 2.0 * (x * x + y * y);
}

/// The unit quaternion x, y, z, w ≥ 0 of a row-major rotation matrix; of a matrix that is one only
/// up to a few digits, a rotation that close. Source: Shepperd, "Quaternion from rotation matrix",
/// 1978: divides by the largest component.
inline void MatrixToQuaternion(const double R[9], double q[4]) {
  // Four times the squares of x, y, z, w.
  const double squares[4] = {1.0 + R[0] - R[4] - R[8], 1.0 - R[0] + R[4] - R[8],
                             1.0 - R[0] - R[4] + R[8], 1.0 + R[0] + R[4] + R[8]};
  int largest = 0;
  for (int k = 1; k < 4; ++k) {
    largest = squares[k] > squares[largest] ? k : largest;
  }
  // Row l holds four times the products of component l with x, y, z, w.
  const double xy = R[1] + R[3], xz = R[2] + R[6], yz = R[5] + R[7];
  const double xw = R[7] - R[5], yw = R[2] - R[6], zw = R[3] - R[1];
  const double products[4][4] = {{squares[0], xy, xz, xw},
                                 {xy, squares[1], yz, yw},
                                 {xz, yz, squares[2], zw},
                                 {xw, yw, zw, squares[3]}};
  const double* row = products[largest];
  double norm = std::sqrt(row[0] * row[0] + row[1] * row[1] + row[2] * row[2] + row[3] * row[3]);
  norm = row[3] < 0.0 ? -norm : norm;
  for (int k = 0; k < 4; ++k) {
    q[k] = row[k] / norm;
  }
}

/// y = M v for a row-major 3×3 matrix. y must not alias v.
inline void MultiplyMatrixVector(const double M[9], const double v[3], double y[3]) {
  for (int r = 0; r < 3; ++r) {
    y[r] = M[3 * r] * v[0] + M[3 * r + 1] * v[1] + M[3 * r + 2] * v[2];
  }
}

/// Rigid motions as plain arrays: planar [x y θ] (meters, radians), spatial [p(3), q(x, y, z, w)]
/// with a unit quaternion, as PoseManifold stores poses. T = (p, R) takes a point of its own frame
/// to R X + p. All functions are pure and allocate nothing.

/// c = a ∘ b, a planar motion after which b is made in the frame it led to; θ_c = θ_a + θ_b, not
/// wrapped. c must not alias.
inline void ComposePlanarPoses(const double a[3], const double b[3], double c[3]) {
  const double cosine = std::cos(a[2]), sine = std::sin(a[2]);
  c[0] = a[0] + cosine * b[0] - sine * b[1];
  c[1] = a[1] + sine * b[0] + cosine * b[1];
  c[2] = a[2] + b[2];
}

/// The planar motion back: a ∘ inverse = 0. inverse must not alias.
inline void InvertPlanarPose(const double a[3], double inverse[3]) {
  const double cosine = std::cos(a[2]), sine = std::sin(a[2]);
  inverse[0] = -cosine * a[0] - sine * a[1];
  inverse[1] = sine * a[0] - cosine * a[1];
  inverse[2] = -a[2];
}

/// y = R X + p. y must not alias.
inline void TransformPoint(const double pose[7], const double X[3], double y[3]) {
  double R[9];
  QuaternionToMatrix(pose + 3, R);
  MultiplyMatrixVector(R, X, y);
  for (int k = 0; k < 3; ++k) {
    y[k] += pose[k];
  }
}

/// c = a ∘ b: R_c = R_a R_b, p_c = p_a + R_a p_b; the quaternion is made of unit length again, so
/// that chains of any length are poses. c must not alias.
inline void ComposePoses(const double a[7], const double b[7], double c[7]) {
  TransformPoint(a, b, c);
  MultiplyQuaternions(a + 3, b + 3, c + 3);
  const double norm = std::sqrt(c[3] * c[3] + c[4] * c[4] + c[5] * c[5] + c[6] * c[6]);
  for (int k = 3; k < 7; ++k) {
    c[k] /= norm;
  }
}

/// The motion back: (−Rᵀ p, Rᵀ). inverse must not alias.
inline void InvertPose(const double a[7], double inverse[7]) {
  const double minus_p[3] = {-a[0], -a[1], -a[2]};
  double back[7] = {0.0, 0.0, 0.0};
  ConjugateQuaternion(a + 3, back + 3);
  TransformPoint(back, minus_p, inverse);
  for (int k = 3; k < 7; ++k) {
    inverse[k] = back[k];
  }
}

}  // namespace inceres
