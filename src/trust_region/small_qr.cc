#include "trust_region/small_qr.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "simd/kernels.h"

namespace inceres::internal {

// Householder QR of few columns with damping rows below (Golub & Van Loan, sections 5.1.2 and
// 5.3.2). Column k has num_rows rows of J, one entry of √Λ in row num_rows + k, and zeros above
// and below that: so the reflection of step k reaches from row k over num_rows + 1 rows and no
// further, and the damping costs one row a step, not num_columns. The kernels read whole quads,
// beyond the last row into zeros. No column is exchanged: the order is the caller's.

void SolveDampedColumns(int num_rows, int num_columns, double* columns, double* scratch,
                        double* x) {
  const Kernels& kernels = BestKernels();
  const int stride = DampedColumnStride(num_rows, num_columns);
  const int height = PadToQuad(num_rows + 1);
  const auto column = [&](int c) { return columns + static_cast<std::ptrdiff_t>(c) * stride; };
  double* const diagonal = scratch;
  // −vᵀ each column from v's own on, then 2 / ‖v‖² vᵀ each column
  double* const dots = scratch + num_columns;
  for (int k = 0; k < num_columns; ++k) {
    // Column k from row k on: it has J's rows and one of √Λ, then zeros, against which others count
    // for nothing.
    double* const v = column(k) + k;
    const int width = num_columns + 1 - k;
    std::fill_n(dots, width, 0.0);
    kernels.subtract_row_dots(1, width, height, v, stride, v, stride, dots, width);
    // dots has −vᵀ each column, itself included.
    const double norm = std::sqrt(-dots[0]);
    // The sign opposite to v₀, so that v₀ − diagonal adds up and does not cancel.
    diagonal[k] = v[0] > 0.0 ? -norm : norm;
    // ‖v‖² after that is 2 (norm² + norm |v₀|).
    const double two_over_v2 = 1.0 / (norm * norm + norm * std::fabs(v[0]));
    // A column of zeros is left alone; its x is then not finite.
    if (norm > 0.0) {
      v[0] -= diagonal[k];
      for (int c = 1; c < width; ++c) {
        dots[c] =
            -two_over_v2 * (dots[c] + diagonal[k] * v[static_cast<std::ptrdiff_t>(c) * stride]);
      }
      kernels.subtract_outer(height, width - 1, 1, v, stride, dots + 1, width, v + stride, stride);
    }
  }
  // f has been reflected with the columns: above the diagonal's end it is Qᵀf, and R x = −Qᵀf.
  const double* const rhs = column(num_columns);
  for (int k = num_columns - 1; k >= 0; --k) {
    double sum = -rhs[k];
    for (int c = k + 1; c < num_columns; ++c) {
      sum -= column(c)[k] * x[c];
    }
    x[k] = sum / diagonal[k];
  }
}

}  // namespace inceres::internal
