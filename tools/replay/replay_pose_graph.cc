#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "inceres/io/g2o_graph.h"
#include "tools/replay/replay_scripts.h"

namespace inceres::tools {
namespace {

constexpr int kLoopGap = 10;  // poses further apart than this close a loop

class PoseGraphScript {
 public:
  PoseGraphScript(const PoseGraph& graph, int first_wrong_edge)
      : graph_(graph),
        first_wrong_edge_(static_cast<std::size_t>(first_wrong_edge)),
        order_(graph.ids.size()),
        position_(graph.ids.size()),
        edges_(graph.ids.size()) {
    std::iota(order_.begin(), order_.end(), 0);
    std::sort(order_.begin(), order_.end(), [&](int a, int b) { return Id(a) < Id(b); });
    for (std::size_t i = 0; i < order_.size(); ++i) {
      position_[static_cast<std::size_t>(order_[i])] = static_cast<int>(i);
    }
    for (std::size_t i = 0; i < graph.edges.size(); ++i) {
      const int later = std::max(Position(graph.edges[i].from), Position(graph.edges[i].to));
      edges_[static_cast<std::size_t>(later)].push_back(i);
    }
  }

  Status Make(std::vector<ReplayStep>* steps) {
    steps->resize(order_.size() - 1);
    for (int i = 0; i < static_cast<int>(order_.size()); ++i) {
      ReplayStep* step = &(*steps)[static_cast<std::size_t>(std::max(i - 1, 0))];
      Status status = AddPose(i, step);
      for (const std::size_t edge : edges_[static_cast<std::size_t>(i)]) {
        status = status.ok() ? AddEdge(edge, step) : status;
      }
      if (!status.ok()) {
        return status;
      }
    }
    return Status::Ok();
  }

 private:
  std::int64_t Id(int vertex) const { return graph_.ids[static_cast<std::size_t>(vertex)]; }
  // Of a vertex in the order of arrival: its variable's number.
  int Position(int vertex) const { return position_[static_cast<std::size_t>(vertex)]; }
  int OtherEnd(std::size_t edge, int vertex) const {
    return graph_.edges[edge].from == vertex ? graph_.edges[edge].to : graph_.edges[edge].from;
  }

  Status AddPose(int position, ReplayStep* step) {
    const int vertex = order_[static_cast<std::size_t>(position)];
    ReplayVariable variable;
    variable.kind =
        graph_.dimension == 2 ? ReplayVariable::Kind::kPlanarPose : ReplayVariable::Kind::kPose;
    std::copy_n(graph_.PoseData(vertex), graph_.PoseSize(), variable.start.begin());
    const bool fixed =
        std::find(graph_.fixed.begin(), graph_.fixed.end(), vertex) != graph_.fixed.end();
    variable.constant = fixed || (position == 0 && graph_.fixed.empty());
    if (position > 0 && !fixed) {
      const std::vector<std::size_t>& edges = edges_[static_cast<std::size_t>(position)];
      if (edges.empty()) {
        return Status::Error(
            StatusCode::kInvalidArgument,
            "vertex " + std::to_string(Id(vertex)) +
                " has no edge to one of a lower id: it has no place when it arrives");
      }
      const std::size_t odometry =
          *std::max_element(edges.begin(), edges.end(), [&](std::size_t a, std::size_t b) {
            return Position(OtherEnd(a, vertex)) < Position(OtherEnd(b, vertex));
          });
      const int neighbor = OtherEnd(odometry, vertex);
      const std::array<double, 7> motion = graph_.MotionFrom(graph_.edges[odometry], neighbor);
      std::copy(motion.begin(), motion.end(), variable.start.begin());
      variable.start_from = Position(neighbor);
    }
    step->variables.push_back(variable);
    return Status::Ok();
  }

  Status AddEdge(std::size_t number, ReplayStep* step) {
    const PoseGraphEdge& edge = graph_.edges[number];
    const int from = Position(edge.from), to = Position(edge.to);
    step->closes_loop = step->closes_loop || std::abs(from - to) > kLoopGap;
    PlanarRelativePoseFamily::Measurement planar;
    RelativePoseFamily::Measurement spatial;
    if (!(graph_.dimension == 2 ? ToMeasurement(edge, &planar) : ToMeasurement(edge, &spatial))) {
      return Status::Error(StatusCode::kInvalidArgument,
                           "edge " + std::to_string(number) + ", from vertex " +
                               std::to_string(Id(edge.from)) + " to " +
                               std::to_string(Id(edge.to)) +
                               ": the information matrix is not positive definite");
    }
    if (graph_.dimension == 2) {
      step->factors.push_back({planar, {from, to}, {}});
    } else {
      step->factors.push_back({spatial, {to, from}, {}});
    }
    step->factors.back().is_suspect = std::abs(from - to) != 1;
    step->factors.back().is_wrong = number >= first_wrong_edge_;
    return Status::Ok();
  }

  const PoseGraph& graph_;
  const std::size_t first_wrong_edge_;
  std::vector<int> order_;                       // vertices in the order of their ids
  std::vector<int> position_;                    // of each vertex in that order
  std::vector<std::vector<std::size_t>> edges_;  // by the position of the later end
};

}  // namespace

Status MakePoseGraphReplay(const PoseGraph& graph, ReplayScript* script, int first_wrong_edge) {
  ReplayScript made;
  made.description = std::to_string(graph.NumVertices()) + " poses in " +
                     std::to_string(graph.dimension) + "D, " + std::to_string(graph.edges.size()) +
                     " edges";
  made.dogleg = true;
  Status status = PoseGraphScript(graph, first_wrong_edge).Make(&made.steps);
  if (status.ok()) {
    *script = std::move(made);
  }
  return status;
}

}  // namespace inceres::tools
