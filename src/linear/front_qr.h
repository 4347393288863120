#pragma once

#include <vector>

#include <Eigen/Core>

#include "linear/front_rows.h"

namespace inceres::internal {

/// Rows of a Jacobian with entries in a few blocks of columns.
struct RowsOfBlocks {
  std::vector<int> blocks;  // each once
  Eigen::MatrixXd values;   // rows × their columns, one block after the other
};

/// R of J = Q R, sparse, in the order and the fronts of a Cholesky factor of JᵀJ, which is L = Rᵀ:
/// of a J of condition number κ exact to κ ε, where that from JᵀJ is exact to κ² ε. Each front
/// stacks its own rows and the triangles that its children leave, and reduces them by Householder
/// reflections, rows in order of size (Cox & Higham, 1998, as in ReduceToTriangle). Cost: per front
/// of n rows 2 m n² flops, m of them stacked. Sources: Liu, "On general row merging schemes for
/// sparse Givens transformations", SIAM J. Sci. Stat. Comput. 7(4), 1986; Davis, "Algorithm 915,
/// SuiteSparseQR", ACM TOMS 38(1), 2011.
class FrontQr {
 public:
  /// A diagonal entry of R that is no larger than `least` counts as zero.
  FrontQr(const FrontTree& tree, const BlockPattern& pattern, double least);

  /// Blocks of the same rows are all neighbors in the pattern.
  void Add(RowsOfBlocks rows);
  /// Writes the columns of front f of L, once its children are done; no entry on the diagonal is
  /// negative. The pivot that the rows leave at zero; −1: there is none.
  int Eliminate(int f, double* L);

 private:
  void StackChild(int child, Eigen::MatrixXd* stack, Eigen::Index* num_rows) const;
  void StackRows(const RowsOfBlocks& rows, int f, Eigen::MatrixXd* stack,
                 Eigen::Index* num_rows) const;

  const FrontTree& tree_;
  const double least_;
  FrontRows rows_;
  std::vector<std::vector<RowsOfBlocks>> added_;  // per front
  std::vector<Eigen::MatrixXd> left_;             // per front, for its parent
};

}  // namespace inceres::internal
