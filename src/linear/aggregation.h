#pragma once

#include <algorithm>
#include <functional>
#include <utility>
#include <vector>

namespace inceres::internal {

/// An undirected graph with weights, each edge at both of its ends, neighbors ascending.
struct WeightedGraph {
  std::vector<int> begin{0};  // per vertex, one more
  std::vector<int> neighbors;
  std::vector<double> weights;  // > 0, per neighbor

  int num_vertices() const { return static_cast<int>(begin.size()) - 1; }
};

/// Groups of vertices that hang together: parts numbered by their lowest vertex.
struct Aggregates {
  std::vector<int> part_of;  // per vertex
  WeightedGraph graph;       // of the parts
};

/// Joins vertices to groups by repeated matching of heavy edges: each round pairs every part with
/// the neighbor it is tied to most, in proportion to their sizes; who is left alone joins a pair
/// next to it, or stays by itself. So round k has parts of about 2^k vertices. Ends with the first
/// round, from `first_round` on, after which `is_small_enough` likes the graph of the parts, or
/// when nothing can be joined any more. Deterministic. Cost: linear in the edges, a round. Source:
/// Karypis & Kumar, "A fast and high quality multilevel scheme for partitioning irregular graphs",
/// SIAM J. Sci. Comput. 20(1), 1998 (heavy-edge matching).
Aggregates AggregateByMatching(const WeightedGraph& graph, int first_round,
                               const std::function<bool(const WeightedGraph&)>& is_small_enough);

/// A partition of the block rows of S (frames), and which pairs of its parts count as neighbors:
/// what a preconditioner keeps of S.
struct FrameClusters {
  std::vector<int> cluster_of;  // per block row
  // per cluster, or empty: up to two others whose coupling is kept as well; −1: none
  std::vector<std::pair<int, int>> neighbors;

  /// Where they are numbered without gaps.
  int num_clusters() const {
    return cluster_of.empty() ? 0 : 1 + *std::max_element(cluster_of.begin(), cluster_of.end());
  }
  /// Whether the block (i, j) is kept.
  bool Keeps(int i, int j) const {
    const int a = cluster_of[i], b = cluster_of[j];
    return a == b || (!neighbors.empty() && (neighbors[a].first == b || neighbors[a].second == b));
  }
};

}  // namespace inceres::internal
