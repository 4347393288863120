#include "linear/aggregation.h"

#include <algorithm>
#include <numeric>
#include <utility>

namespace inceres::internal {

// Heavy-edge matching (docs/algorithms.md, "Reduced linear systems", two levels; Karypis & Kumar
// 1998). A round pairs each vertex with the neighbor it is tied to most, contracts the graph to the
// groups, and the next round works on that. Weights are divided by the number of original vertices
// on both sides, so that parts of like size join and no part swallows its surroundings.
//
// The result has to be the same for any number of threads and in every run: vertices are visited by
// index, among equal weights the first neighbor wins, and groups are numbered by their lowest
// member. No vertex has an edge to itself, which Heaviest relies on: Contract drops what falls
// within a group.

namespace {

// A round that leaves more than this share of the parts is not worth another.
constexpr double kStalled = 0.95;
// A pair takes up to two who found no partner.
constexpr int kLargestGroup = 4;

// Per part the group it goes to, groups numbered by their lowest part.
class Matching {
 public:
  Matching(const WeightedGraph& graph, const std::vector<int>& sizes)
      : graph_(graph), sizes_(sizes), group_(graph.num_vertices(), -1) {}

  std::vector<int> Match() {
    for (int v = 0; v < graph_.num_vertices(); ++v) {
      if (group_[v] < 0) {
        // The vertices are visited in their own order and not by weight: greedy, one pass over the
        // edges.
        const int partner = Heaviest(v, [&](int u) { return group_[u] < 0; });
        if (partner >= 0) {
          group_[v] = group_[partner] = static_cast<int>(counts_.size());
          counts_.push_back(2);
        }
      }
    }
    for (int v = 0; v < graph_.num_vertices(); ++v) {
      if (group_[v] < 0) {
        // Whoever is left has no free neighbor. Alone it would stay small round after round, so it
        // joins a group next to it while that has room, or else keeps its own.
        const int host = Heaviest(
            v, [&](int u) { return group_[u] >= 0 && counts_[group_[u]] < kLargestGroup; });
        group_[v] = host >= 0 ? group_[host] : static_cast<int>(counts_.size());
        host >= 0 ? static_cast<void>(++counts_[group_[v]]) : counts_.push_back(1);
      }
    }
    NumberByLowest();
    return std::move(group_);
  }

 private:
  // The neighbor with the largest weight by sizes among those allowed; -1 if there is none. The
  // comparison is strict: of equals the lowest neighbor stays.
  template <typename Allowed>
  int Heaviest(int v, const Allowed& allowed) const {
    int best = -1;
    double heaviest = 0.0;
    for (int k = graph_.begin[v]; k < graph_.begin[v + 1]; ++k) {
      const int u = graph_.neighbors[k];
      const double weight = graph_.weights[k] / (sizes_[u] + sizes_[v]);
      if (weight > heaviest && allowed(u)) {
        best = u;
        heaviest = weight;
      }
    }
    return best;
  }

  // Groups were numbered as pairs came about. The first part that is met in ascending order gives
  // its group the next number, so the numbering tells nothing of how the matching went.
  void NumberByLowest() {
    std::vector<int> number(counts_.size(), -1);
    int next = 0;
    for (int& group : group_) {
      number[group] = number[group] < 0 ? next++ : number[group];
      group = number[group];
    }
  }

  const WeightedGraph& graph_;
  const std::vector<int>& sizes_;
  std::vector<int> group_;
  std::vector<int> counts_;  // parts per group
};

// The graph of the groups.
WeightedGraph Contract(const WeightedGraph& graph, const std::vector<int>& group, int num_groups) {
  std::vector<std::vector<int>> members(num_groups);
  for (int v = 0; v < graph.num_vertices(); ++v) {
    // The weights between two groups are summed in ascending order of the members: one order of the
    // sum.
    members[group[v]].push_back(v);
  }
  WeightedGraph contracted;
  std::vector<double> weight(num_groups, 0.0);
  std::vector<int> found;
  for (int g = 0; g < num_groups; ++g) {
    for (const int v : members[g]) {
      for (int k = graph.begin[v]; k < graph.begin[v + 1]; ++k) {
        // A weight is positive, so zero tells that this neighbor has not been found yet.
        const int other = group[graph.neighbors[k]];
        if (other != g && weight[other] == 0.0) {
          found.push_back(other);
        }
        weight[other] += other != g ? graph.weights[k] : 0.0;
      }
    }
    // The callers rely on neighbors that ascend.
    std::sort(found.begin(), found.end());
    for (const int other : found) {
      contracted.neighbors.push_back(other);
      contracted.weights.push_back(std::exchange(weight[other], 0.0));
    }
    found.clear();
    contracted.begin.push_back(static_cast<int>(contracted.neighbors.size()));
  }
  return contracted;
}

}  // namespace

Aggregates AggregateByMatching(const WeightedGraph& graph, int first_round,
                               const std::function<bool(const WeightedGraph&)>& is_small_enough) {
  Aggregates result;
  result.graph = graph;
  result.part_of.resize(graph.num_vertices());
  std::iota(result.part_of.begin(), result.part_of.end(), 0);
  std::vector<int> sizes(graph.num_vertices(), 1);
  // The first rounds are made whatever the graph looks like: asking whether it is small enough
  // costs a symbolic factorization of the coarse system.
  for (int round = 0; round < first_round || !is_small_enough(result.graph); ++round) {
    const std::vector<int> group = Matching(result.graph, sizes).Match();
    const int before = result.graph.num_vertices();
    const int after = group.empty() ? 0 : 1 + *std::max_element(group.begin(), group.end());
    // Too few pairs were found: the parts hardly hang together any more, and more rounds would end
    // up with the same graph.
    if (after == 0 || after > kStalled * before) {
      break;
    }
    std::vector<int> joined(after, 0);
    for (int v = 0; v < before; ++v) {
      joined[group[v]] += sizes[v];
    }
    sizes = std::move(joined);
    result.graph = Contract(result.graph, group, after);
    // From parts of the last round to parts of this one.
    for (int& part : result.part_of) {
      part = group[part];
    }
  }
  return result;
}

}  // namespace inceres::internal
