#include "schur/landmark_factor.h"

#include <cmath>

namespace inceres::internal {

namespace {

template <int kSize>
bool InvertFactorOf(const double* P, const double* damping, double* U_inv) {
  double L[kSize][kSize];
  for (int j = 0; j < kSize; ++j) {
    double pivot = P[j * kQuad + j] + damping[j];
    for (int k = 0; k < j; ++k) {
      pivot -= L[j][k] * L[j][k];
    }
    if (!(pivot > 0.0) || !std::isfinite(pivot)) {
      return false;
    }
    L[j][j] = 1.0 / std::sqrt(pivot);  // of the diagonal only the inverse is wanted
    for (int i = j + 1; i < kSize; ++i) {
      double sum = P[i * kQuad + j];
      for (int k = 0; k < j; ++k) {
        sum -= L[i][k] * L[j][k];
      }
      L[i][j] = sum * L[j][j];
    }
  }
  for (int j = 0; j < kSize; ++j) {
    U_inv[j * kQuad + j] = L[j][j];
    for (int i = j + 1; i < kSize; ++i) {
      double sum = 0.0;
      for (int k = j; k < i; ++k) {
        sum -= L[i][k] * U_inv[k * kQuad + j];
      }
      U_inv[i * kQuad + j] = sum * L[i][i];
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
