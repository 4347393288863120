#include "schur/visibility_clusters.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <tuple>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include "base/counting_sort.h"
#include "base/sort_unique.h"
#include "linear/aggregation.h"

namespace inceres::internal {

// Clusters of frames for CLUSTER_JACOBI and CLUSTER_TRIDIAGONAL, by the rules of Ceres 2.1
// (docs/algorithms.md, "Reduced linear systems", clusters). The sources are Simon, Snavely & Seitz
// 2007 for canonical views and Kushal & Agarwal 2012 for the preconditioner. What is wanted is not
// a good clustering but Ceres's: the same clusters give the same iterations of conjugate gradients.
//
// Ceres keeps frames and centers in unordered containers and lets the order in them decide ties and
// numbers. So the containers here are of the same kind and are filled in the same order. Where no
// similarities are equal, and each frame is like some center, that order decides nothing but
// numbers.
//
// The graph of similarities has each frame as its own neighbor, with weight 1.

namespace {

// Ceres's.
constexpr double kCenterPenalty = 3.0;
constexpr std::size_t kFewestCenters = 3;
constexpr double kLinked = 0.9;

// Landmarks that each two frames share, over the geometric mean of what each sees; a frame with
// itself: 1.
WeightedGraph Similarities(const Visibility& visibility) {
  std::vector<int> seen_begin, seen;  // landmarks, per frame
  const auto for_each_incidence = [&](const auto& add) {
    for (int l = 0; l < visibility.num_landmarks(); ++l) {
      for (int q = visibility.begin[l]; q < visibility.begin[l + 1]; ++q) {
        add(visibility.frames[q], l);
      }
    }
  };
  CountingSort(static_cast<std::size_t>(visibility.num_frames), for_each_incidence, &seen_begin,
               &seen);
  const auto num_seen = [&](int frame) {
    return static_cast<double>(seen_begin[frame + 1] - seen_begin[frame]);
  };
  WeightedGraph graph;
  // common is all zeros between two frames: each entry that was counted up is taken out again.
  std::vector<int> common(visibility.num_frames, 0), found;
  for (int i = 0; i < visibility.num_frames; ++i) {
    found.assign(1, i);
    for (int k = seen_begin[i]; k < seen_begin[i + 1]; ++k) {
      for (int q = visibility.begin[seen[k]]; q < visibility.begin[seen[k] + 1]; ++q) {
        const int j = visibility.frames[q];
        if (j != i && common[j]++ == 0) {
          found.push_back(j);
        }
      }
    }
    // Ascending neighbors: one order of the sums of gains.
    std::sort(found.begin(), found.end());
    for (const int j : found) {
      graph.neighbors.push_back(j);
      graph.weights.push_back(
          j == i ? 1.0 : std::exchange(common[j], 0) / std::sqrt(num_seen(i) * num_seen(j)));
    }
    graph.begin.push_back(static_cast<int>(graph.neighbors.size()));
  }
  return graph;
}

// The order in which an unordered set has 0 … n − 1 that came in one after the other.
std::vector<int> OrderOfVertices(int count) {
  std::unordered_set<int> vertices;
  for (int v = 0; v < count; ++v) {
    vertices.insert(v);
  }
  return {vertices.begin(), vertices.end()};
}

// Numbers clusters in the order in which an unordered map from frames meets them.
std::vector<int> Renumber(const std::vector<int>& order, const std::vector<int>& cluster_of) {
  // Ceres keeps the membership in such a map and numbers clusters as it comes across them.
  std::unordered_map<int, int> membership;
  for (const int frame : order) {
    membership.emplace(frame, cluster_of[frame]);
  }
  std::unordered_map<int, int> number;
  std::vector<int> result(cluster_of.size());
  for (const auto& [frame, cluster] : membership) {
    result[frame] = number.emplace(cluster, static_cast<int>(number.size())).first->second;
  }
  return result;
}

class CanonicalViews {
 public:
  explicit CanonicalViews(const WeightedGraph& graph)
      : graph_(graph),
        similarity_(graph.num_vertices(), 0.0),
        center_of_(graph.num_vertices(), -1) {}

  // Greedy: each round takes the view that adds most. The gain of a view falls as centers come, for
  // the similarities to the nearest center rise, but is not kept: all are computed again each
  // round.
  std::vector<int> Cluster(const std::vector<int>& order) {
    std::unordered_set<int> views;
    for (const int view : order) {
      views.insert(view);
    }
    std::vector<int> cluster_of_center(graph_.num_vertices(), -1);
    std::size_t num_centers = 0;
    while (!views.empty()) {
      int best = -1;
      // A gain may be negative, and the first three centers are taken all the same.
      double most = -std::numeric_limits<double>::max();
      for (const int view : views) {
        const double gain = Gain(view);
        if (gain > most) {
          most = gain;
          best = view;
        }
      }
      // The gain has the penalty in it: a center is worth it while it adds more than that.
      if (most <= 0.0 && num_centers >= kFewestCenters) {
        break;
      }
      views.erase(best);
      cluster_of_center[best] = static_cast<int>(num_centers++);
      Assign(best);
    }
    std::vector<int> cluster_of(graph_.num_vertices());
    for (int v = 0; v < graph_.num_vertices(); ++v) {  // who is like none goes anywhere
      cluster_of[v] =
          center_of_[v] >= 0 ? cluster_of_center[center_of_[v]] : v % static_cast<int>(num_centers);
    }
    return cluster_of;
  }

 private:
  // By how much the similarities to the nearest center would rise in sum, less the penalty.
  double Gain(int view) const {
    double gain = 0.0;
    for (int k = graph_.begin[view]; k < graph_.begin[view + 1]; ++k) {
      gain += std::max(0.0, graph_.weights[k] - similarity_[graph_.neighbors[k]]);
    }
    return gain - kCenterPenalty;
  }
  // Frames go to the center they are most like; of equals the earlier center keeps them.
  void Assign(int center) {
    for (int k = graph_.begin[center]; k < graph_.begin[center + 1]; ++k) {
      const int view = graph_.neighbors[k];
      if (graph_.weights[k] > similarity_[view]) {
        similarity_[view] = graph_.weights[k];
        center_of_[view] = center;
      }
    }
  }

  const WeightedGraph& graph_;
  std::vector<double> similarity_;  // per view, to its center
  std::vector<int> center_of_;
};

// Union and find; the lowest stands for its set.
class DisjointSets {
 public:
  explicit DisjointSets(int count) : parent_(count) {
    std::iota(parent_.begin(), parent_.end(), 0);
  }
  int Find(int v) {
    while (parent_[v] != v) {
      // Paths are halved on the way.
      v = parent_[v] = parent_[parent_[v]];
    }
    return v;
  }
  // False if they were one already.
  bool Join(int a, int b) {
    a = Find(a);
    b = Find(b);
    // Where a and b are the same this sets a root to itself.
    parent_[std::max(a, b)] = std::min(a, b);
    return a != b;
  }

 private:
  std::vector<int> parent_;
};

// Connected components of the pairs that are alike enough. The numbers are those of lowest frames,
// with gaps; Renumber closes them.
std::vector<int> SingleLinkage(const WeightedGraph& graph) {
  DisjointSets sets(graph.num_vertices());
  for (int v = 0; v < graph.num_vertices(); ++v) {
    for (int k = graph.begin[v]; k < graph.begin[v + 1]; ++k) {
      if (graph.weights[k] >= kLinked) {
        sets.Join(v, graph.neighbors[k]);
      }
    }
  }
  std::vector<int> cluster_of(graph.num_vertices());
  for (int v = 0; v < graph.num_vertices(); ++v) {
    cluster_of[v] = sets.Find(v);
  }
  return cluster_of;
}

// A spanning forest of paths, greedy by the number of landmarks that two clusters share (Kruskal).
std::vector<std::pair<int, int>> FindPaths(const Visibility& visibility,
                                           const std::vector<int>& cluster_of, int count) {
  std::vector<std::pair<std::int64_t, int>> pairs;  // the pair as one number, and its landmarks
  std::unordered_map<std::int64_t, int> common;
  std::vector<int> seen;
  for (int l = 0; l < visibility.num_landmarks(); ++l) {
    seen.clear();
    for (int q = visibility.begin[l]; q < visibility.begin[l + 1]; ++q) {
      seen.push_back(cluster_of[visibility.frames[q]]);
    }
    // A landmark counts once for a pair of clusters, however many of their frames see it.
    SortUnique(&seen);
    for (std::size_t a = 0; a < seen.size(); ++a) {
      for (std::size_t b = a + 1; b < seen.size(); ++b) {
        // The lower cluster first: one number for a pair.
        ++common[std::int64_t{seen[a]} * count + seen[b]];
      }
    }
  }
  pairs.assign(common.begin(), common.end());
  std::sort(pairs.begin(), pairs.end(), [](const auto& a, const auto& b) {
    // The most landmarks first, among equals the higher pair: a complete order, whatever the map
    // had.
    return std::tie(a.second, a.first) > std::tie(b.second, b.first);
  });
  std::vector<std::pair<int, int>> neighbors(count, {-1, -1});
  DisjointSets sets(count);
  for (const auto& [pair, landmarks] : pairs) {
    const int a = static_cast<int>(pair / count), b = static_cast<int>(pair % count);
    // Two neighbors at most, and no cycle: what comes about are paths. Join has to come last, for
    // it changes the sets.
    if (neighbors[a].second < 0 && neighbors[b].second < 0 && sets.Join(a, b)) {
      (neighbors[a].first < 0 ? neighbors[a].first : neighbors[a].second) = b;
      (neighbors[b].first < 0 ? neighbors[b].first : neighbors[b].second) = a;
    }
  }
  return neighbors;
}

}  // namespace

FrameClusters FindVisibilityClusters(const Visibility& visibility, bool single_linkage,
                                     bool tridiagonal) {
  const WeightedGraph graph = Similarities(visibility);
  const std::vector<int> order = OrderOfVertices(graph.num_vertices());
  FrameClusters clusters;
  // The order stands for that in which Ceres's graph has its vertices: it decides ties and numbers.
  clusters.cluster_of =
      Renumber(order, single_linkage ? SingleLinkage(graph) : CanonicalViews(graph).Cluster(order));
  if (tridiagonal) {
    clusters.neighbors = FindPaths(visibility, clusters.cluster_of, clusters.num_clusters());
  }
  return clusters;
}

}  // namespace inceres::internal
