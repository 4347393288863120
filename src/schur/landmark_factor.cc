#include "schur/landmark_factor.h"

#include <cmath>

#include "block/kernels.h"

namespace inceres::internal {

bool InvertCholeskyFactor(int size, const double* P, const double* damping, double* U_inv) {
  double L[4][4];
  for (int j = 0; j < size; ++j) {
    double pivot = P[j * kQuad + j] + damping[j];
    for (int k = 0; k < j; ++k) {
      pivot -= L[j][k] * L[j][k];
    }
    if (!(pivot > 0.0) || !std::isfinite(pivot)) {
      return false;
    }
    L[j][j] = std::sqrt(pivot);
    for (int i = j + 1; i < size; ++i) {
      double sum = P[i * kQuad + j];
      for (int k = 0; k < j; ++k) {
        sum -= L[i][k] * L[j][k];
      }
      L[i][j] = sum / L[j][j];
    }
  }
  for (int j = 0; j < size; ++j) {
    U_inv[j * kQuad + j] = 1.0 / L[j][j];
    for (int i = j + 1; i < size; ++i) {
      double sum = 0.0;
      for (int k = j; k < i; ++k) {
        sum -= L[i][k] * U_inv[k * kQuad + j];
      }
      U_inv[i * kQuad + j] = sum / L[i][i];
    }
  }
  return true;
}

void MultiplyLower(int size, const double* U_inv, const double* x, double* z) {
  for (int k = 0; k < size; ++k) {
    z[k] = 0.0;
    for (int c = 0; c <= k; ++c) {
      z[k] += U_inv[k * kQuad + c] * x[c];
    }
  }
}

void MultiplyLowerTransposed(int size, const double* U_inv, const double* y, double* x) {
  for (int c = 0; c < size; ++c) {
    x[c] = 0.0;
    for (int k = c; k < size; ++k) {
      x[c] += U_inv[k * kQuad + c] * y[k];
    }
  }
}

}  // namespace inceres::internal
