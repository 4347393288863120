#include "marginal/row_elimination.h"

#include <numeric>

#include <Eigen/QR>

#include "linear/rows_by_size.h"

namespace inceres::internal {

// Householder QR that is exact row by row (Cox & Higham 1998; docs/algorithms.md,
// "Marginalization"). The rows of one system may differ by many orders of magnitude in weight. A
// reflection mixes rows, and with rows in any order the rounding of a large one ends up in a small
// one. Rows sorted by size, and the column taken that has the largest norm left, bound the error in
// each row by that row's own size; it takes both.
//
// What is computed of A = [J_m J_r f] is its first `count` columns' elimination: the rows below the
// rank are orthogonal to all that J_m could explain.

namespace {

// By what rows say about the columns of J: f does not count, for a large residual does not make a
// row a heavy one.
void SortRows(Eigen::MatrixXd* A) {
  if (A->cols() > 1) {
    *A = SortedRows(*A, A->leftCols(A->cols() - 1));
  }
}

// Takes column `pivot` out of rows [k, …): a reflection that leaves it in row k alone, applied to
// the columns listed and to those from `first` on.
void Reflect(Eigen::Index k, Eigen::Index pivot, const std::vector<Eigen::Index>& columns,
             Eigen::Index first, Eigen::MatrixXd* A) {
  const Eigen::Index rows = A->rows() - k;
  Eigen::VectorXd v = A->col(pivot).tail(rows);
  double beta = 0.0;
  double tau = 0.0;
  Eigen::VectorXd essential(rows - 1);
  // The reflection is 1 − τ u uᵀ with u = (1, essential).
  v.makeHouseholder(essential, tau, beta);
  Eigen::VectorXd workspace(A->cols());
  // Only columns that are still to be eliminated, and those that stay: finished ones are not
  // brought up to date, since nobody reads them.
  for (const Eigen::Index column : columns) {
    A->col(column).tail(rows).applyHouseholderOnTheLeft(essential, tau, workspace.data());
  }
  A->bottomRightCorner(rows, A->cols() - first)
      .applyHouseholderOnTheLeft(essential, tau, workspace.data());
}

}  // namespace

EliminationOutcome EliminateColumns(int count, double tolerance, Eigen::MatrixXd* A) {
  EliminationOutcome outcome;
  if (A->rows() == 0 || count == 0) {
    // Without rows nothing is measured.
    outcome.dependent.resize(static_cast<std::size_t>(count));
    std::iota(outcome.dependent.begin(), outcome.dependent.end(), 0);
    return outcome;
  }
  SortRows(A);
  // stableNorm scales before it squares, so that no weight overflows or vanishes in a norm.
  const Eigen::VectorXd norms = A->leftCols(count).colwise().stableNorm();
  std::vector<Eigen::Index> left(static_cast<std::size_t>(count));
  std::iota(left.begin(), left.end(), Eigen::Index{0});
  Eigen::Index rank = 0;
  while (!left.empty() && rank < A->rows()) {
    // By the norm that is left, and not by its share of the norm of before: a stiff row that hardly
    // has a column would be mixed into weak ones by that column's reflection.
    auto best = left.end();
    double largest = 0.0;
    for (auto column = left.begin(); column != left.end(); ++column) {
      // Small matrices: the norms are computed anew, as downdating loses digits.
      const double norm = A->col(*column).tail(A->rows() - rank).stableNorm();
      // False for numbers that are not.
      if (norm > largest && norm > tolerance * norms[*column]) {
        largest = norm;
        best = column;
      }
    }
    // All that are left are dependent.
    if (best == left.end()) {
      break;
    }
    const Eigen::Index pivot = *best;
    left.erase(best);
    Reflect(rank, pivot, left, count, A);
    ++rank;
  }
  outcome.rank = static_cast<int>(rank);
  outcome.dependent.assign(left.begin(), left.end());
  return outcome;
}

double ReduceToTriangle(Eigen::MatrixXd* A) {
  const Eigen::Index n = A->cols() - 1;
  Eigen::MatrixXd triangle = Eigen::MatrixXd::Zero(n, n + 1);
  double rest = 0.0;
  if (A->rows() <= n) {
    triangle.topRows(A->rows()) = *A;
  } else {
    SortRows(A);
    // f is the last column of the factorization: below n its one entry is what no x explains.
    const Eigen::HouseholderQR<Eigen::Ref<Eigen::MatrixXd>> qr(*A);
    triangle = A->topRows(n).triangularView<Eigen::Upper>();
    rest = (*A)(n, n) * (*A)(n, n);
  }
  A->swap(triangle);
  return rest;
}

}  // namespace inceres::internal
