#include "linear/small_cholesky.h"

namespace inceres::internal {

// U_inv = L⁻¹ with L Lᵀ = P + Λ_l of one landmark (docs/algorithms.md, "Schur complement"). Sizes
// are 1 to 4, so each has code of its own: with a size that is a constant the loops unroll and the
// block can stay in registers. The operations and their order are the same as with a size that is
// not.
//
// U_inv is written when the factor exists, entry by entry below the diagonal; what is above it is
// not touched. Whoever calls keeps zeros there, or does not read it.

namespace {

template <int kSize>
bool InvertFactorOf(const double* P, const double* damping, double* U_inv) {
  double L[kSize * kQuad];
  double inverse_pivots[kSize];
  for (int i = 0; i < kSize; ++i) {
    for (int j = 0; j < i; ++j) {
      L[i * kQuad + j] = P[i * kQuad + j];
    }
    L[i * kQuad + i] = P[i * kQuad + i] + damping[i];
  }
  // Nothing has been written yet: U_inv is as it was.
  if (!FactorSmall(kSize, L, kQuad, inverse_pivots)) {
    return false;
  }
  for (int j = 0; j < kSize; ++j) {
    // Column j of the inverse by forward substitution of a unit vector: it is zero above the
    // diagonal.
    U_inv[j * kQuad + j] = inverse_pivots[j];
    for (int i = j + 1; i < kSize; ++i) {
      double sum = 0.0;
      for (int k = j; k < i; ++k) {
        sum -= L[i * kQuad + k] * U_inv[k * kQuad + j];
      }
      U_inv[i * kQuad + j] = sum * inverse_pivots[i];
    }
  }
  return true;
}

}  // namespace

bool InvertCholeskyFactor(int size, const double* P, const double* damping, double* U_inv) {
  switch (size) {
    case 1:
      return InvertFactorOf<1>(P, damping, U_inv);
    case 2:
      return InvertFactorOf<2>(P, damping, U_inv);
    case 3:
      return InvertFactorOf<3>(P, damping, U_inv);
    default:
      return InvertFactorOf<4>(P, damping, U_inv);
  }
}

}  // namespace inceres::internal
