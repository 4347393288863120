#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <vector>

#include <Eigen/Core>

namespace inceres::internal {

/// The rows of a matrix by the size of their largest entry, largest first, ties in their order: how
/// Householder reflections take them to be accurate row by row (Cox & Higham 1998). Rows with NaN
/// come first, as if they were infinite: NaN compares with nothing, and would leave the others in
/// any order.
inline std::vector<Eigen::Index> LargestRowsFirst(const Eigen::Ref<const Eigen::MatrixXd>& rows) {
  std::vector<Eigen::Index> order(static_cast<std::size_t>(rows.rows()));
  std::iota(order.begin(), order.end(), Eigen::Index{0});
  if (rows.size() == 0) {
    return order;
  }
  Eigen::VectorXd sizes = rows.cwiseAbs().rowwise().maxCoeff();
  // What maxCoeff makes of NaN is open.
  sizes = rows.array().isNaN().rowwise().any().select(HUGE_VAL, sizes.array());
  std::stable_sort(order.begin(), order.end(),
                   [&](Eigen::Index a, Eigen::Index b) { return sizes[a] > sizes[b]; });
  return order;
}

/// The rows of A, as many as `by` has, in the order of those of `by`, largest first.
inline Eigen::MatrixXd SortedRows(const Eigen::MatrixXd& A,
                                  const Eigen::Ref<const Eigen::MatrixXd>& by) {
  const std::vector<Eigen::Index> order = LargestRowsFirst(by);
  Eigen::MatrixXd sorted(by.rows(), A.cols());
  for (Eigen::Index row = 0; row < by.rows(); ++row) {
    sorted.row(row) = A.row(order[static_cast<std::size_t>(row)]);
  }
  return sorted;
}

}  // namespace inceres::internal
