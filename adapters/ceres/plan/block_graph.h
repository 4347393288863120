#pragma once

#include <vector>

#include "adapters/ceres/read/introspection.h"

namespace inceres::internal {

/// Variable blocks that share a residual block are neighbors: Ceres's Hessian graph.
class BlockGraph {
 public:
  explicit BlockGraph(const ProblemView& view);

  /// In order of first appearance.
  const std::vector<int>& order() const { return order_; }
  const std::vector<int>& Neighbors(int b) const { return neighbors_[static_cast<std::size_t>(b)]; }
  std::size_t num_blocks() const { return neighbors_.size(); }

 private:
  std::vector<int> order_;
  std::vector<std::vector<int>> neighbors_;
};

/// Takes independent sets from a graph until nothing is left: blocks in the order of their number
/// of neighbors left, each unless a neighbor has been taken. Ties are broken by first appearance.
class IndependentSets {
 public:
  /// The graph outlives it.
  explicit IndependentSets(const BlockGraph& graph);

  bool empty() const { return left_.empty(); }
  std::vector<int> TakeOne();

 private:
  const BlockGraph& graph_;
  std::vector<int> left_;
  std::vector<int> degree_;
  std::vector<int> met_;  // per block: the last set one of its neighbors is in
  int num_sets_ = 0;
};

}  // namespace inceres::internal
