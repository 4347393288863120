#pragma once

#include <vector>

#include "inceres/linear/reduced_solver.h"

namespace inceres::internal {

/// The paths in S, such as the odometry between two loops: nodes with two neighbors. A node is a
/// few block rows that are coupled to each other and to the same others, as the position and the
/// rotation of a pose are. Nodes on paths have at most kMostTileScalars scalars, and their
/// neighbors have as many.
struct BlockPaths {
  static constexpr int kNone = -1;

  /// Nodes that follow each other, and the nodes before the first and behind the last, which are on
  /// no path: maybe one and the same, and kNone where a path ends freely. Only the first may be
  /// kNone, or both.
  struct Path {
    int begin = 0, end = 0;  // among `nodes`
    int anchor = kNone, next = kNone;
    int size = 0;  // scalars of each of the nodes
  };

  std::vector<int> node_of;  // per block row
  // per node, and one more: where its block rows begin among `blocks`
  std::vector<int> node_begin{0};
  std::vector<int> blocks;     // ascending within a node
  std::vector<int> node_size;  // per node: its scalars
  std::vector<int> nodes;      // path by path
  std::vector<Path> paths;

  int num_nodes() const { return static_cast<int>(node_begin.size()) - 1; }
};

/// Cost: a few passes over the blocks of S.
BlockPaths FindBlockPaths(const BlockPattern& pattern);

}  // namespace inceres::internal
