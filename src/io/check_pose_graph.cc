#include "io/check_pose_graph.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>

namespace inceres::internal {
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

}  // namespace inceres::internal
