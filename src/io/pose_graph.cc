#include "io/pose_graph.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <functional>
#include <queue>
#include <string>
#include <tuple>
#include <vector>

#include "inceres/io/pose_graph_start.h"
#include "inceres/problem/rotation.h"

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

Status BadPoseGraph(const std::string& what) {
  return Status::Error(StatusCode::kInvalidArgument, "PoseGraph: " + what);
}

// Of the first `count`: planar edges leave the rest of their arrays unused.
template <typename Values>
bool AreFinite(const Values& values, std::size_t count) {
  return std::all_of(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(count),
                     [](double value) { return std::isfinite(value); });
}

// Edges and FIX lists name vertices by index; ids, which the file has, may be anything.
bool IsVertex(const PoseGraph& graph, int index) {
  return index >= 0 && index < graph.NumVertices();
}

// The dimension first: the sizes of everything else follow from it.
Status CheckVertices(const PoseGraph& graph) {
  if (graph.dimension != 2 && graph.dimension != 3) {
    return BadPoseGraph("dimension is " + std::to_string(graph.dimension) + ", not 2 or 3");
  }
  const std::size_t expected = graph.ids.size() * static_cast<std::size_t>(graph.PoseSize());
  if (graph.poses.size() != expected) {
    return BadPoseGraph("poses has " + std::to_string(graph.poses.size()) + " values instead of " +
                        std::to_string(expected));
  }
  // By number and not by vertex: the size is right, and the message says where to look.
  for (std::size_t i = 0; i < graph.poses.size(); ++i) {
    if (!std::isfinite(graph.poses[i])) {
      return BadPoseGraph("poses[" + std::to_string(i) + "] is not finite");
    }
  }
  for (std::size_t i = 0; i < graph.fixed.size(); ++i) {
    if (!IsVertex(graph, graph.fixed[i])) {
      return BadPoseGraph("fixed[" + std::to_string(i) + "] is no vertex");
    }
  }
  return Status::Ok();
}

}  // namespace

Status CheckPoseGraph(const PoseGraph& graph) {
  const auto pose_size = static_cast<std::size_t>(graph.PoseSize());
  const auto size = static_cast<std::size_t>(graph.TangentSize());
  // Vertices before edges, whose ends are held against them. The first fault is what is reported,
  // by the name of the member and the index in it.
  Status status = CheckVertices(graph);
  for (std::size_t i = 0; i < graph.edges.size() && status.ok(); ++i) {
    const PoseGraphEdge& edge = graph.edges[i];
    if (!IsVertex(graph, edge.from) || !IsVertex(graph, edge.to)) {
      status = BadPoseGraph("edges[" + std::to_string(i) + "] has an end that is no vertex");
      // Finite is all that is asked of an information: a file may be written of a graph that no
      // solver would take.
    } else if (!AreFinite(edge.measurement, pose_size) ||
               !AreFinite(edge.information, size * size)) {
      status = BadPoseGraph("edges[" + std::to_string(i) + "] has a value that is not finite");
    }
  }
  return status;
}

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

std::string NoWay(const PoseGraph& graph, int lost) {
  return "no edges lead from vertex " + std::to_string(graph.ids.front()) + " to vertex " +
         std::to_string(graph.ids[static_cast<std::size_t>(lost)]);
}

std::array<double, 7> InSpace(const double* planar_pose) {
  const double half = 0.5 * planar_pose[2];
  return {planar_pose[0], planar_pose[1], 0.0, 0.0, 0.0, std::sin(half), std::cos(half)};
}

}  // namespace internal

// Places a copy from the origin, then moves all of it as one: that the first vertex stays does not
// change the others' places relative to it.
Status StartAlongSpanningTree(PoseGraph* graph) {
  if (Status status = internal::CheckPoseGraph(*graph); !status.ok()) {
    return status;
  }
  if (graph->ids.empty()) {
    return Status::Error(StatusCode::kInvalidArgument, "spanning tree: the graph has no vertices");
  }
  PoseGraph placed = *graph;
  const int lost = internal::PlaceAlongEdges(&placed);
  if (lost < graph->NumVertices()) {
    return Status::Error(StatusCode::kInvalidArgument,
                         "spanning tree: " + internal::NoWay(*graph, lost));
  }
  // From the origin to where the first vertex is.
  const std::vector<double> first(graph->PoseData(0), graph->PoseData(0) + graph->PoseSize());
  for (int i = 0; i < graph->NumVertices(); ++i) {
    (graph->dimension == 2 ? ComposePlanarPoses : ComposePoses)(first.data(), placed.PoseData(i),
                                                                graph->PoseData(i));
  }
  return Status::Ok();
}

}  // namespace inceres
