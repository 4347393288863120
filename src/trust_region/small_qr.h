#pragma once

#include "simd/kernels.h"

namespace inceres::internal {

/// Entries from one column to the next in what SolveDampedColumns works on.
constexpr int DampedColumnStride(int num_rows, int num_columns) {
  return PadToQuad(num_rows + 1) + num_columns;
}

/// Minimizes ‖J x + f‖² + ‖√Λ x‖² by Householder reflections of [J f; √Λ 0], column by column,
/// which it overwrites: num_columns + 1 columns, each of J's num_rows, then the num_columns of √Λ,
/// then zeros up to the stride. x is not finite if there is not full column rank. `scratch` has 2
/// num_columns + 1 entries. Cost: two passes over the columns behind it for each column, as far as
/// it is not zero, along the columns: fast for few of them. Source: Golub & Van Loan, "Matrix
/// Computations", 2013, sections 5.1.2 and 5.3.2.
void SolveDampedColumns(int num_rows, int num_columns, double* columns, double* scratch, double* x);

}  // namespace inceres::internal
