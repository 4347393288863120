#pragma once

#include <utility>
#include <vector>

namespace inceres::internal {

/// A partition of the block rows of S (frames), and which pairs of its parts count as neighbors:
/// what a preconditioner keeps of S.
struct FrameClusters {
  std::vector<int> cluster_of;  // per block row
  // per cluster, or empty: up to two others whose coupling is kept as well; −1: none
  std::vector<std::pair<int, int>> neighbors;

  /// Whether the block (i, j) is kept.
  bool Keeps(int i, int j) const {
    const int a = cluster_of[i], b = cluster_of[j];
    return a == b || (!neighbors.empty() && (neighbors[a].first == b || neighbors[a].second == b));
  }
};

}  // namespace inceres::internal
