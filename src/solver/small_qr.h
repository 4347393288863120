#pragma once

namespace inceres::internal {

/// Minimises ‖J x + f‖² + ‖√Λ x‖² by Householder reflections of the rows [J f; √Λ 0], row-major, `stride` ≥ num_columns + 1
/// apart, a multiple of four: first num_rows of J, then the num_columns of √Λ, whose zeros are known to be there. Overwrites the
/// rows. x is not finite if the rows have not full column rank. `scratch` has num_rows + num_columns entries. Cost: two passes
/// over the rows a column, so for few columns. Source: Golub & Van Loan, "Matrix Computations", 2013, sections 5.1.2 and 5.3.2.
void SolveDampedRows(int num_rows, int num_columns, double* rows, int stride, double* scratch, double* x);

}  // namespace inceres::internal
