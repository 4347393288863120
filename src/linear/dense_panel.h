#pragma once

#include <cstddef>

namespace inceres::internal {

// What the dense Cholesky and the fronts of the sparse one share: the diagonal blocks of a
// column-major lower triangle, and blocks of S on their way there. Source: Golub & Van Loan,
// "Matrix Computations", section 4.2.

/// PlaceBlock of a size that is known before.
template <int kRows, int kColumns>
inline void PlaceSized(const double* block, int block_stride, int first_row, int first_column,
                       double* A, std::ptrdiff_t stride) {
  if (first_row < first_column) {
    double* out = A + first_row * stride + first_column;
    for (int r = 0; r < kRows; ++r, block += block_stride, out += stride) {
      for (int c = 0; c < kColumns; ++c) {
        out[c] = block[c];
      }
    }
    return;
  }
  double* out = A + first_column * stride + first_row;
  const bool is_diagonal = first_row == first_column;
  for (int c = 0; c < kColumns; ++c, out += stride) {
    for (int r = 0; r < kRows; ++r) {
      if (!is_diagonal || r >= c) {
        out[r] = block[r * block_stride + c];
      }
    }
  }
}

/// PlaceBlock of whatever size.
void PlaceAnyBlock(const double* block, int block_stride, int rows, int columns, int first_row,
                   int first_column, double* A, std::ptrdiff_t stride);

/// Writes a block of S, rows × columns and row-major, `block_stride` from row to row, into A, where
/// its rows start at first_row and its columns at first_column; turned where it would be above the
/// diagonal. Of a block on the diagonal the lower triangle is read and written.
inline void PlaceBlock(const double* block, int block_stride, int rows, int columns, int first_row,
                       int first_column, double* A, std::ptrdiff_t stride) {
  // Most blocks of a pose graph are such: no call for nine entries.
  if (rows == 3 && columns == 3) {
    PlaceSized<3, 3>(block, block_stride, first_row, first_column, A, stride);
  } else {
    PlaceAnyBlock(block, block_stride, rows, columns, first_row, first_column, A, stride);
  }
}

/// L Lᵀ = A in the place of A, width × width; columns have room for whole quads of rows, and what
/// lies behind the last row there may be anything. False, and the column that failed, where A is
/// not positive definite or not finite.
bool FactorDiagonalBlock(double* A, int stride, int width, int* failed);

/// y := L⁻¹ y and y := L⁻ᵀ y for such an L.
void SolveTriangle(const double* L, int stride, int width, double* y);
void SolveTransposedTriangle(const double* L, int stride, int width, double* y);

}  // namespace inceres::internal
