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
// its root. With the number of columns known there are no loops left.
template <int kWidth>
// `failed` counts columns of the triangle. Columns before it are written, and the caller gives the
// whole factor up.
bool FactorTriangle(double* A, std::ptrdiff_t stride, int* failed) {
  double L[kWidth][kWidth];  // by columns
#pragma GCC unroll 4
  for (int j = 0; j < kWidth; ++j) {
#pragma GCC unroll 4
    for (int i = j; i < kWidth; ++i) {
      L[j][i] = A[j * stride + i];
    }
#pragma GCC unroll 4
    for (int k = 0; k < j; ++k) {
#pragma GCC unroll 4
      for (int i = j; i < kWidth; ++i) {
        L[j][i] -= L[k][i] * L[k][j];
      }
    }
    // The comparison fails for NaN as well.
    if (!(L[j][j] > 0.0) || !std::isfinite(L[j][j])) {
      *failed = j;
      return false;
    }
    const double root = std::sqrt(L[j][j]);
    A[j * stride + j] = L[j][j] = root;
    // By division, not by the product with an inverse: rounded once.
#pragma GCC unroll 4
    for (int i = j + 1; i < kWidth; ++i) {
      A[j * stride + i] = L[j][i] /= root;
    }
  }
  return true;
}

bool FactorTriangle(double* A, int stride, int width, int* failed) {
  switch (width) {
    case 1:
      return FactorTriangle<1>(A, stride, failed);
    case 2:
      return FactorTriangle<2>(A, stride, failed);
    case 3:
      return FactorTriangle<3>(A, stride, failed);
    default:
      return FactorTriangle<4>(A, stride, failed);
  }
}

// Of poses, of velocities with biases, and of what lies between them; null: of other sizes.
decltype(&PlaceSized<6, 6>) FindPlaceSized(int rows, int columns) {
  if (rows > 9 || columns > 9) {
    return nullptr;
  }
  switch (16 * rows + columns) {
    case 16 * 6 + 6:
      return PlaceSized<6, 6>;
    case 16 * 6 + 9:
      return PlaceSized<6, 9>;
    case 16 * 9 + 6:
      return PlaceSized<9, 6>;
    case 16 * 9 + 9:
      return PlaceSized<9, 9>;
    default:
      return nullptr;
  }
}

}  // namespace

// Called for every block of S and every factorization. The usual block lies below the diagonal: the
// destination is written along its columns. A is column-major and S row-major, so one of the two is
// walked with a stride: mostly S, whose blocks are small.
void PlaceAnyBlock(const double* block, int block_stride, int rows, int columns, int first_row,
                   int first_column, double* A, std::ptrdiff_t stride) {
  if (const auto place = FindPlaceSized(rows, columns)) {
    return place(block, block_stride, first_row, first_column, A, stride);
  }
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
// Triangles of four: what is between the calls of the kernels is then unrolled, and the kernels
// have four columns at a time.
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
      kernels.subtract_lower_outer(whole_quads, rows, size, column + below, stride,
                                   A + static_cast<std::ptrdiff_t>(below) * stride + below, stride);
    }
  }
  return true;
}

// Four columns at a time, each entry of y less one product after the other, as by single columns.
// Parentheses fix the order of the differences; so the rows below, which do not depend on each
// other, may be done by vectors, and y is read and written once for four columns.
void SolveTriangle(const double* __restrict__ L, int stride, int width, double* __restrict__ y) {
  for (int j = 0; j < width; j += kTriangle) {
    const double* column = L + static_cast<std::ptrdiff_t>(j) * stride;
    const int end = std::min(j + kTriangle, width);
    for (int k = j; k < end; ++k, column += stride) {
      y[k] /= column[k];
      for (int i = k + 1; i < end; ++i) {
        y[i] -= column[i] * y[k];
      }
    }
    if (end < width) {  // then there are four
      const double* a = L + static_cast<std::ptrdiff_t>(j) * stride;
      const double *b = a + stride, *c = b + stride, *d = c + stride;
      const double y_a = y[j], y_b = y[j + 1], y_c = y[j + 2], y_d = y[j + 3];
      for (int i = end; i < width; ++i) {
        y[i] = (((y[i] - a[i] * y_a) - b[i] * y_b) - c[i] * y_c) - d[i] * y_d;
      }
    }
  }
}

// By columns of L, too, which are rows of Lᵀ: y_j is a dot product with what is known below.
void SolveTransposedTriangle(const double* L, int stride, int width, double* y) {
  for (int j = width - 1; j >= 0; --j) {
    const double* column = L + static_cast<std::ptrdiff_t>(j) * stride;
    double sum = y[j];
#pragma GCC unroll 4
    for (int i = j + 1; i < width; ++i) {
      sum -= column[i] * y[i];
    }
    y[j] = sum / column[j];
  }
}

}  // namespace inceres::internal
