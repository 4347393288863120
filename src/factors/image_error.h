#pragma once

#include <cmath>

namespace inceres::internal {

// Errors of a direction h in a camera (a point times any factor but 0) and their derivatives A =
// ∂e/∂h, written if A is not null.

/// e = h_xy / h_z − z, A = [I | −u] / h_z with u = h_xy / h_z.
inline void PlaneError(const double h[3], const double z[2], double e[2], double A[2][3]) {
  const double u[2] = {h[0] / h[2], h[1] / h[2]};
  for (int r = 0; r < 2; ++r) {
    e[r] = u[r] - z[r];
    if (A != nullptr) {
      A[r][0] = r == 0 ? 1.0 / h[2] : 0.0;
      A[r][1] = r == 1 ? 1.0 / h[2] : 0.0;
      A[r][2] = -u[r] / h[2];
    }
  }
}

inline double Norm(const double v[3]) {
  return std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

/// Two orthonormal rows that span the plane across the unit vector d; at d = (0, 0, ±1) they are
/// the x and ±y axes, and they follow d smoothly in each half-space of z. Source: Duff et al.,
/// "Building an orthonormal basis, revisited", 2017.
inline void TangentBasis(const double d[3], double B[2][3]) {
  const double sign = std::copysign(1.0, d[2]);
  const double a = -1.0 / (sign + d[2]);
  const double b = d[0] * d[1] * a;
  B[0][0] = 1.0 + sign * d[0] * d[0] * a;
  B[0][1] = sign * b;
  B[0][2] = -sign * d[0];
  B[1][0] = b;
  B[1][1] = sign + d[1] * d[1] * a;
  B[1][2] = -d[1];
}

/// e = B (h / ‖h‖ − d), A = B (I − ĥ ĥᵀ) / ‖h‖.
inline void SphereError(const double h[3], const double d[3], const double B[2][3], double e[2],
                        double A[2][3]) {
  const double norm = Norm(h);
  const double direction[3] = {h[0] / norm, h[1] / norm, h[2] / norm};
  for (int r = 0; r < 2; ++r) {
    const double along = B[r][0] * direction[0] + B[r][1] * direction[1] + B[r][2] * direction[2];
    e[r] = along - (B[r][0] * d[0] + B[r][1] * d[1] + B[r][2] * d[2]);
    for (int k = 0; k < 3 && A != nullptr; ++k) {
      A[r][k] = (B[r][k] - along * direction[k]) / norm;
    }
  }
}

}  // namespace inceres::internal
