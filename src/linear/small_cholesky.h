#pragma once

#include <cmath>
#include <cstddef>

namespace inceres::internal {

/// Cholesky of a small block's lower triangle, in place, row-major. The reciprocals of L's diagonal spare later divisions. False
/// at a pivot that is not positive and finite.
inline bool FactorSmall(int size, double* A, int lda, double* inverse_pivots) {
  for (int i = 0; i < size; ++i) {
    double* row = A + static_cast<std::ptrdiff_t>(i) * lda;
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
inline void SolveSmall(int size, const double* L, int ldl, const double* inverse_pivots, double* x) {
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

}  // namespace inceres::internal
