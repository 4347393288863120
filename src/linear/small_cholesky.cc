#include "linear/small_cholesky.h"

namespace inceres::internal {
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
  if (!FactorSmall(kSize, L, kQuad, inverse_pivots)) {
    return false;
  }
  for (int j = 0; j < kSize; ++j) {
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
