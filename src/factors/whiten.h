#pragma once

#include <algorithm>

namespace inceres::internal {

/// J = U E, U upper triangular (rows × rows), E rows × columns, both row-major; rows of J are
/// row_stride apart. Returns the sum of the entries of J, which is finite only if all are. J must
/// not alias E.
template <int rows, int columns>
double MultiplyUpper(const double* U, const double* E, double* J, int row_stride) {
  double sum = 0.0;
  for (int r = 0; r < rows; ++r) {
    double row[columns] = {};
    for (int k = r; k < rows; ++k) {
      for (int c = 0; c < columns; ++c) {
        row[c] += U[rows * r + k] * E[columns * k + c];
      }
    }
    for (int c = 0; c < columns; ++c) {
      sum += row[c];
    }
    std::copy_n(row, columns, J + r * row_stride);
  }
  return sum;
}

}  // namespace inceres::internal
