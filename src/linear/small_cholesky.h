#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "simd/kernels.h"

namespace inceres::internal {

// Cholesky of small blocks. A size that is a constant (WithConstantSize) lets loops be unrolled:
// the same operations in the same order.

/// L Lᵀ = A of a small block's lower triangle, in place, row-major. The reciprocals of L's diagonal
/// spare later divisions. False at a pivot that is not positive and finite.
inline bool FactorSmall(int size, double* A, int lda, double* inverse_pivots) {
#pragma GCC unroll 4
  for (int i = 0; i < size; ++i) {
    double* row = A + static_cast<std::ptrdiff_t>(i) * lda;
#pragma GCC unroll 4
    for (int j = 0; j <= i; ++j) {
      const double* other = A + static_cast<std::ptrdiff_t>(j) * lda;
      double sum = row[j];
      for (int k = 0; k < j; ++k) {
        sum -= row[k] * other[k];
      }
      if (i > j) {
        row[j] = sum * inverse_pivots[j];
      } else if (sum > 0.0 && std::isfinite(sum)) {
        row[i] = std::sqrt(sum);
        inverse_pivots[i] = 1.0 / row[i];
      } else {
        return false;
      }
    }
  }
  return true;
}

/// x := (L Lᵀ)⁻¹ x with the factor of FactorSmall.
inline void SolveSmall(int size, const double* L, int ldl, const double* inverse_pivots,
                       double* x) {
  for (int i = 0; i < size; ++i) {
    for (int k = 0; k < i; ++k) {
      x[i] -= L[static_cast<std::ptrdiff_t>(i) * ldl + k] * x[k];
    }
    x[i] *= inverse_pivots[i];
  }
  for (int i = size - 1; i >= 0; --i) {
    for (int k = i + 1; k < size; ++k) {
      x[i] -= L[static_cast<std::ptrdiff_t>(k) * ldl + i] * x[k];
    }
    x[i] *= inverse_pivots[i];
  }
}

/// minus_inverse = −A⁻¹, whole rows, `stride` apart and zero beyond `size`, from the lower triangle
/// of A, which its factor replaces. False as FactorSmall. The inverse is symmetric: its columns are
/// found as rows.
inline bool NegateInverse(int size, double* A, int lda, double* inverse_pivots, int stride,
                          double* minus_inverse) {
  if (!FactorSmall(size, A, lda, inverse_pivots)) {
    return false;
  }
  for (int r = 0; r < size; ++r, minus_inverse += stride) {
    std::fill_n(minus_inverse, stride, 0.0);
    minus_inverse[r] = -1.0;
    SolveSmall(size, A, lda, inverse_pivots, minus_inverse);
  }
  return true;
}

/// D_kk of a landmark's damping λD: its diagonal entry of P, and 1e-12 at least. Where P is next to
/// nothing, a step that its own entry damps is as good as a Gauss–Newton step, however far out the
/// landmark is: an inverse depth that tends to infinity would be squared by each, until no number
/// holds it. A zero stays zero: damping does not make up for information.
inline double LandmarkDampingScale(double diagonal) {
  constexpr double kLeastDiagonal = 1e-12;
  return diagonal > 0.0 ? std::max(diagonal, kLeastDiagonal) : 0.0;
}

/// U_inv = L⁻¹ with L Lᵀ = P + diag(damping) of one landmark's block, size 1 to 4, rows four apart.
/// False, and U_inv as it was, if a pivot is not positive and finite.
bool InvertCholeskyFactor(int size, const double* P, const double* damping, double* U_inv);

/// Entry (i, i) of U_invᵀ U_inv, the inverse of what was factored: a coordinate's variance where
/// all frames are known.
inline double VarianceOfCoordinate(int size, const double* U_inv, int i) {
  double variance = 0.0;
  for (int k = i; k < size; ++k) {
    variance += U_inv[k * kQuad + i] * U_inv[k * kQuad + i];
  }
  return variance;
}

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
