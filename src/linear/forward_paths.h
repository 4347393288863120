#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include <Eigen/Core>

#include "linear/clique_tree.h"

namespace inceres::internal {

/// Columns that are zero but in a few block rows of S.
struct SparseColumns {
  std::vector<int> rows;   // of S, in any order, without repeats
  std::vector<int> begin;  // per row: where it begins in `values`
  Eigen::MatrixXd values;  // what these rows have, one below the other
};

/// y = L⁻¹V of a Bayes tree in some cliques, as long as that is not factored again: of each front a
/// row of `lanes` columns after the other, so that a vector does several columns, or a single
/// column. Cliques are told by their places in the order of their stamps, which rise from children
/// to parents: a forward pass in this order finds all that is below it done.
class ForwardPaths {
 public:
  ForwardPaths() = default;  // of no columns
  /// L⁻¹V: the cliques between the rows of V and the root. Cost: one pass over L there.
  ForwardPaths(const CliqueTree& tree, const SparseColumns& V);
  /// One column of zeros, for SolveForward; all cliques.
  explicit ForwardPaths(const CliqueTree& tree);

  int size() const { return static_cast<int>(cliques_.size()); }
  const Clique& clique(int i) const { return tree_->clique(cliques_[i]); }
  double* Of(int i);
  /// y₁ of this clique, and what it leaves to its parent.
  void SolveForward(int i);
  /// thisᵀ other, of the same tree, with the padding of the columns to lanes.
  Eigen::MatrixXd InnerProducts(const ForwardPaths& other) const;

 private:
  void LayOut();
  int Find(int c, int from) const;

  const CliqueTree* tree_ = nullptr;
  int lanes_ = 0;
  std::vector<int> cliques_;
  std::vector<std::size_t> begin_;  // per clique, one more
  std::unique_ptr<double[]> values_;
  std::vector<char> is_begun_;
};

}  // namespace inceres::internal
