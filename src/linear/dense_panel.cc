#include "linear/dense_panel.h"

#include <algorithm>
#include <cmath>

#include "simd/kernels.h"

namespace inceres::internal {

// The triangles that panels of the dense factor and fronts of the sparse ones end in
// (docs/algorithms.md, "Reduced linear systems"): L Lᵀ of a diagonal block, the substitutions with
// it, and the way of a block of S into the column-major lower triangle. Larger products are the
// kernels' work.
//
// All of it is in place. The lower triangle counts, while entries above it, and in rows behind the
// last one up to a whole quad, may be read and written and mean nothing, so that the kernels have
// no remainders. There is no pivoting: the matrix is positive definite or it has no factor, and a
// pivot that is zero, negative, infinite or NaN says so.

namespace {

constexpr int kTriangle = 4;  // what of a diagonal block is factored by hand

// Column by column, left-looking: columns ahead are subtracted first, then the column is divided by
// its root.
bool FactorTriangle(double* A, int stride, int width, int* failed) {
  for (int j = 0; j < width; ++j) {
    double* column = A + static_cast<std::ptrdiff_t>(j) * stride;
    for (int k = 0; k < j; ++k) {
      const double* other = A + static_cast<std::ptrdiff_t>(k) * stride;
      for (int i = j; i < width; ++i) {
        column[i] -= other[i] * other[j];
      }
    }
    // The comparison fails for NaN as well.
    if (!(column[j] > 0.0) || !std::isfinite(column[j])) {
      *failed = j;
      return false;
    }
    const double root = std::sqrt(column[j]);
    column[j] = root;
    // By division, not by the product with an inverse: rounded once.
    for (int i = j + 1; i < width; ++i) {
      column[i] /= root;
    }
  }
  return true;
}

}  // namespace

// Called for every block of S and every factorization. The usual block lies below the diagonal: the
// destination is written along its columns.
void PlaceBlock(const double* block, int block_stride, int rows, int columns, int first_row,
                int first_column, double* A, std::ptrdiff_t stride) {
  // It would be above the diagonal: turned, its rows become columns, which are copied whole.
  if (first_row < first_column) {
    for (int r = 0; r < rows; ++r) {
      std::copy_n(block + static_cast<std::ptrdiff_t>(r) * block_stride, columns,
                  A + (first_row + r) * stride + first_column);
    }
    return;
  }
  for (int c = 0; c < columns; ++c) {
    double* out = A + (first_column + c) * stride + first_row;
    // Of a block on the diagonal only what is below it.
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
    // Rows behind the last one are in the panel's padding, or in a triangle that nobody reads.
    const int whole_quads = PadToQuad(rows);  // no loop over a last few rows
    double* column = A + static_cast<std::ptrdiff_t>(j) * stride;
    if (!FactorTriangle(column + j, stride, size, failed)) {
      // From a column of the triangle to one of the block.
      *failed += j;
      return false;
    }
    if (rows > 0) {
      kernels.solve_lower_transposed(whole_quads, size, column + j, stride, column + below, stride);
      // What is subtracted above the diagonal of the rest is not used.
      kernels.subtract_outer(whole_quads, rows, size, column + below, stride, column + below,
                             stride, A + static_cast<std::ptrdiff_t>(below) * stride + below,
                             stride);
    }
  }
  return true;
}

// By columns, along memory: each y_j, once known, is taken out of the rows below.
void SolveTriangle(const double* L, int stride, int width, double* y) {
  for (int j = 0; j < width; ++j) {
    const double* column = L + static_cast<std::ptrdiff_t>(j) * stride;
    y[j] /= column[j];
    for (int i = j + 1; i < width; ++i) {
      y[i] -= column[i] * y[j];
    }
  }
}

// By columns of L, too, which are rows of Lᵀ: y_j is a dot product with what is known below.
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
