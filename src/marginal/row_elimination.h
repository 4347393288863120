#pragma once

#include <vector>

#include <Eigen/Core>

namespace inceres::internal {

/// What EliminateColumns found.
struct EliminationOutcome {
  int rank = 0;  // rows [0, rank) hold the eliminated columns
  // columns, ascending, along which the rows said nothing new; as many as the rank falls short
  std::vector<int> dependent;
};

/// Orthogonal elimination of the first `count` columns of A = [J_m J_r f] by Householder
/// reflections, in place: afterwards rows from `rank` on, columns from `count` on, are [J* f*],
/// what the rows say about the other columns whatever the first ones are.
///
/// Rows are sorted by size, and the column comes next whose norm is the largest left, which makes
/// the result exact row by row: a row of size 1e-1 keeps its digits beside one of 1e7, where
/// without it errors of the large one would go into all (Cox & Higham, "Stability of Householder
/// QR factorization for weighted least squares problems", 1998). A column counts as dependent when
/// what is left of it is below `tolerance` of its norm. Cost: 2 · rows · count · columns
/// multiplications.
EliminationOutcome EliminateColumns(int count, double tolerance, Eigen::MatrixXd* A);

/// Reduces A = [J f] to its upper triangle, of as many rows as J has columns (rows of zeros if A
/// has fewer): same JᵀJ and Jᵀf. Returns the squared norm of what is left of f below it, the part
/// that no x can change.
double ReduceToTriangle(Eigen::MatrixXd* A);

}  // namespace inceres::internal
