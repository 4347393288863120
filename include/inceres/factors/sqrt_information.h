#pragma once

#include <cmath>

namespace inceres {

/// The upper triangular U with UᵀU = information (row-major, size × size, symmetric positive definite; only its upper triangle is
/// read): ‖U r‖² = rᵀ information r, so U whitens a residual. Writes U row-major with zeros below the diagonal. Returns false, U
/// then undefined, if the matrix is not positive definite or not finite. U must not alias information. Allocates nothing.
/// Source: Golub & Van Loan, "Matrix Computations", 4th ed., section 4.2 (Cholesky, outer-product form).
[[nodiscard]] inline bool SqrtInformation(const double* information, int size, double* U) {
  for (int r = 0; r < size; ++r) {
    for (int c = 0; c < size; ++c) {
      double sum = c < r ? 0.0 : information[r * size + c];
      for (int k = 0; c >= r && k < r; ++k) {
        sum -= U[k * size + r] * U[k * size + c];
      }
      if (c == r) {
        if (!(sum > 0.0) || !std::isfinite(sum)) {
          return false;
        }
        U[r * size + r] = std::sqrt(sum);
      } else {
        U[r * size + c] = c < r ? 0.0 : sum / U[r * size + r];
      }
    }
  }
  for (int k = 0; k < size * size; ++k) {
    if (!std::isfinite(U[k])) {
      return false;
    }
  }
  return true;
}

}  // namespace inceres
