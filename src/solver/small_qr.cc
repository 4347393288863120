#include "solver/small_qr.h"

#include <cmath>
#include <cstddef>

#include "block/kernels.h"

namespace inceres::internal {
namespace {

// A quad of columns of all rows: rows −= v (2 / ‖v‖²) vᵀ rows.
void ReflectQuad(const double* v, int num_rows, double two_over_v2, double* rows, int stride) {
  double w[kQuad] = {};
  const double* from = rows;
  for (int r = 0; r < num_rows; ++r, from += stride) {
    for (int c = 0; c < kQuad; ++c) {
      w[c] += v[r] * from[c];
    }
  }
  for (double& entry : w) {
    entry *= two_over_v2;
  }
  for (int r = 0; r < num_rows; ++r, rows += stride) {
    for (int c = 0; c < kQuad; ++c) {
      rows[c] -= v[r] * w[c];
    }
  }
}

}  // namespace

void SolveDampedRows(int num_rows, int num_columns, double* rows, int stride, double* scratch, double* x) {
  for (int k = 0; k < num_columns; ++k) {
    // Column k from row k on; of √Λ the rows up to k: those below still are as they were.
    const int height = num_rows + 1;
    double* const pivot_row = rows + static_cast<std::ptrdiff_t>(k) * stride;
    double* const v = scratch;
    double below = 0.0;
    for (int r = 0; r < height; ++r) {
      v[r] = pivot_row[static_cast<std::ptrdiff_t>(r) * stride + k];
      below += r == 0 ? 0.0 : v[r] * v[r];
    }
    const double norm = std::sqrt(v[0] * v[0] + below);
    const double reflected = v[0] > 0.0 ? -norm : norm;
    v[0] -= reflected;
    const double v2 = v[0] * v[0] + below;
    for (int c = k / kQuad * kQuad; c <= num_columns && v2 > 0.0; c += kQuad) {
      ReflectQuad(v, height, 2.0 / v2, pivot_row + c, stride);
    }
    pivot_row[k] = reflected;
  }
  for (int k = num_columns - 1; k >= 0; --k) {
    const double* row = rows + static_cast<std::ptrdiff_t>(k) * stride;
    double sum = -row[num_columns];
    for (int c = k + 1; c < num_columns; ++c) {
      sum -= row[c] * x[c];
    }
    x[k] = sum / row[k];
  }
}

}  // namespace inceres::internal
