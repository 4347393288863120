#pragma once

#include <cmath>

#include "inceres/problem/rotation.h"

namespace inceres {

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
