#include "linear/dense_panel.h"

#include <algorithm>
#include <cmath>

#include "simd/kernels.h"

namespace inceres::internal {
namespace {

constexpr int kTriangle = 4;  // what of a diagonal block is factored by hand

bool FactorTriangle(double* A, int stride, int width, int* failed) {
  for (int j = 0; j < width; ++j) {
    double* column = A + static_cast<std::ptrdiff_t>(j) * stride;
    for (int k = 0; k < j; ++k) {
      const double* other = A + static_cast<std::ptrdiff_t>(k) * stride;
      for (int i = j; i < width; ++i) {
        column[i] -= other[i] * other[j];
      }
    }
    if (!(column[j] > 0.0) || !std::isfinite(column[j])) {
      *failed = j;
      return false;
    }
    const double root = std::sqrt(column[j]);
    column[j] = root;
    for (int i = j + 1; i < width; ++i) {
      column[i] /= root;
    }
  }
  return true;
}

}  // namespace

void PlaceBlock(const double* block, int block_stride, int rows, int columns, int first_row,
                int first_column, double* A, std::ptrdiff_t stride) {
  if (first_row < first_column) {
    for (int r = 0; r < rows; ++r) {
      std::copy_n(block + static_cast<std::ptrdiff_t>(r) * block_stride, columns,
                  A + (first_row + r) * stride + first_column);
    }
    return;
  }
  for (int c = 0; c < columns; ++c) {
    double* out = A + (first_column + c) * stride + first_row;
    for (int r = first_row == first_column ? c : 0; r < rows; ++r) {
      out[r] = block[r * block_stride + c];
    }
  }
}

// Right-looking: a small triangle, the rows below it, what they take from the rest of the block.
bool FactorDiagonalBlock(double* A, int stride, int width, int* failed) {
  const Kernels& kernels = BestKernels();
  for (int j = 0; j < width; j += kTriangle) {
    const int size = std::min(kTriangle, width - j);
    const int below = j + size;
    const int rows = width - below;
    const int whole_quads = PadToQuad(rows);  // no loop over a last few rows
    double* column = A + static_cast<std::ptrdiff_t>(j) * stride;
    if (!FactorTriangle(column + j, stride, size, failed)) {
      *failed += j;
      return false;
    }
    if (rows > 0) {
      kernels.solve_lower_transposed(whole_quads, size, column + j, stride, column + below, stride);
      kernels.subtract_outer(whole_quads, rows, size, column + below, stride, column + below,
                             stride, A + static_cast<std::ptrdiff_t>(below) * stride + below,
                             stride);
    }
  }
  return true;
}

void SolveTriangle(const double* L, int stride, int width, double* y) {
  for (int j = 0; j < width; ++j) {
    const double* column = L + static_cast<std::ptrdiff_t>(j) * stride;
    y[j] /= column[j];
    for (int i = j + 1; i < width; ++i) {
      y[i] -= column[i] * y[j];
    }
  }
}

void SolveTransposedTriangle(const double* L, int stride, int width, double* y) {
  for (int j = width - 1; j >= 0; --j) {
    const double* column = L + static_cast<std::ptrdiff_t>(j) * stride;
    for (int i = j + 1; i < width; ++i) {
      y[j] -= column[i] * y[i];
    }
    y[j] /= column[j];
  }
}

}  // namespace inceres::internal
