#pragma once

#include "simd/kernels.h"

namespace inceres::internal {

/// The Cholesky factor of one landmark's block, size 1 to 4, rows four apart: U_inv = L⁻¹ with L Lᵀ = P + diag(damping). False if
/// a pivot is not positive and finite.
bool InvertCholeskyFactor(int size, const double* P, const double* damping, double* U_inv);

/// z = U_inv x for the lower triangular U_inv.
inline void MultiplyLower(int size, const double* U_inv, const double* x, double* z) {
  for (int k = 0; k < size && k < kQuad; ++k) {
    z[k] = 0.0;
    for (int c = 0; c <= k; ++c) {
      z[k] += U_inv[k * kQuad + c] * x[c];
    }
  }
}

/// x = U_invᵀ y for the lower triangular U_inv.
inline void MultiplyLowerTransposed(int size, const double* U_inv, const double* y, double* x) {
  for (int c = 0; c < size && c < kQuad; ++c) {
    x[c] = 0.0;
    for (int k = c; k < size && k < kQuad; ++k) {
      x[c] += U_inv[k * kQuad + c] * y[k];
    }
  }
}

}  // namespace inceres::internal
