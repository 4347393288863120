#include "io/g2o_start.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <functional>
#include <queue>
#include <tuple>
#include <vector>

#include "inceres/problem/pose_composition.h"

// Start values along edges: each vertex is put where one edge says, seen from a vertex that has its
// place already. Which edge that is decides how much noise adds up. A tree of least depth would go
// through loops, any of which may be wrong; following the odometry, from each vertex to the next
// one, goes through none. A priority queue makes that choice without knowing what an odometry is:
// lowest vertex first, and of the edges to it the one from the highest vertex that is placed.

namespace inceres {

std::array<double, 7> PoseGraph::MotionFrom(const PoseGraphEdge& edge, int vertex) const {
  std::array<double, 7> motion = edge.measurement;
  if (vertex != edge.from) {
    (dimension == 2 ? InvertPlanarPose : InvertPose)(edge.measurement.data(), motion.data());
  }
  return motion;
}

// T_other = T_vertex · motion.
std::array<double, 7> PoseGraph::AcrossEdge(const PoseGraphEdge& edge, int vertex,
                                            const double* pose) const {
  const std::array<double, 7> motion = MotionFrom(edge, vertex);
  std::array<double, 7> other{};
  (dimension == 2 ? ComposePlanarPoses : ComposePoses)(pose, motion.data(), other.data());
  return other;
}

namespace internal {
namespace {

class Placer {
 public:
  // Edges of each vertex, ascending, both ends alike.
  explicit Placer(PoseGraph* graph)
      : graph_(*graph), edges_of_(graph->ids.size()), placed_(graph->ids.size(), false) {
    for (std::size_t i = 0; i < graph_.edges.size(); ++i) {
      edges_of_[static_cast<std::size_t>(graph_.edges[i].from)].push_back(i);
      edges_of_[static_cast<std::size_t>(graph_.edges[i].to)].push_back(i);
    }
  }

  // Prim's algorithm with another order: each edge enters the queue once, from the end that is
  // placed first. Requires a vertex.
  int Place() {
    graph_.poses.assign(graph_.ids.size() * static_cast<std::size_t>(graph_.PoseSize()), 0.0);
    // The identity's quaternion, w last.
    if (graph_.dimension == 3) {
      graph_.PoseData(0)[6] = 1.0;
    }
    SetPlaced(0);
    while (!candidates_.empty()) {
      // The edge leads from the neighbor, whose pose is known, to the vertex.
      const auto [vertex, minus_neighbor, edge] = candidates_.top();
      candidates_.pop();
      // Candidates of a vertex that was placed by a better one in the meantime are passed over.
      if (!placed_[static_cast<std::size_t>(vertex)]) {
        const std::array<double, 7> pose = graph_.AcrossEdge(graph_.edges[edge], -minus_neighbor,
                                                             graph_.PoseData(-minus_neighbor));
        std::copy_n(pose.begin(), graph_.PoseSize(), graph_.PoseData(vertex));
        SetPlaced(vertex);
      }
    }
    // The lowest vertex without a place; its pose is zeros, and of no use.
    return static_cast<int>(std::find(placed_.begin(), placed_.end(), false) - placed_.begin());
  }

 private:
  // A tuple that compares as the choice is made: the negated neighbor puts the highest first, and
  // the edge settles parallel ones, by the order of the file.
  using Candidate =
      std::tuple<int, int,
                 std::size_t>;  // the vertex to place, minus the one to start from, the edge

  // Its edges to vertices without a place become candidates.
  void SetPlaced(int vertex) {
    placed_[static_cast<std::size_t>(vertex)] = true;
    for (const std::size_t edge : edges_of_[static_cast<std::size_t>(vertex)]) {
      const int other =
          graph_.edges[edge].from == vertex ? graph_.edges[edge].to : graph_.edges[edge].from;
      if (!placed_[static_cast<std::size_t>(other)]) {
        candidates_.emplace(other, -vertex, edge);
      }
    }
  }

  PoseGraph& graph_;
  std::vector<std::vector<std::size_t>> edges_of_;
  std::vector<bool> placed_;
  std::priority_queue<Candidate, std::vector<Candidate>, std::greater<>> candidates_;
};

}  // namespace

int PlaceAlongEdges(PoseGraph* graph) {
  return Placer(graph).Place();
}

}  // namespace internal
}  // namespace inceres
