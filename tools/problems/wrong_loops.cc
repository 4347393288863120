#include "tools/problems/wrong_loops.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <set>
#include <string>
#include <utility>

#include "inceres/io/g2o_graph.h"
#include "inceres/problem/rotation.h"

namespace inceres::tools {
namespace {

// Draws that are in vain, a wrong loop, before there are none.
constexpr int kMaxDraws = 1000;

class LoopDealer {
 public:
  LoopDealer(const WrongLoopOptions& options, const PoseGraph& reference, const PoseGraph& graph)
      : options_(options),
        reference_(reference),
        graph_(graph),
        loops_(LoopEdges(graph)),
        order_(VerticesById(graph)),
        engine_(options.seed) {
    for (const PoseGraphEdge& edge : graph.edges) {
      joined_.insert(std::minmax(edge.from, edge.to));
    }
  }

  // False if none is found.
  bool Draw(PoseGraphEdge* edge) {
    for (int i = 0; i < kMaxDraws; ++i) {
      *edge = graph_.edges[static_cast<std::size_t>(loops_[Below(loops_.size())])];
      const std::size_t a = Below(order_.size()), b = Below(order_.size());
      edge->from = order_[a];
      edge->to = order_[b];
      const bool neighbors = std::max(a, b) - std::min(a, b) <= 1;
      if (!neighbors && SquaredError(reference_, *edge) > options_.least_squared_error &&
          joined_.insert(std::minmax(edge->from, edge->to)).second) {
        return true;
      }
    }
    return false;
  }

  std::size_t num_loops() const { return loops_.size(); }

 private:
  std::size_t Below(std::size_t count) { return static_cast<std::size_t>(engine_() % count); }

  const WrongLoopOptions& options_;
  const PoseGraph& reference_;
  const PoseGraph& graph_;
  std::vector<int> loops_;
  std::vector<int> order_;
  std::set<std::pair<int, int>> joined_;
  std::mt19937_64 engine_;
};

Status NoLoops(const char* why) {
  return Status::Error(StatusCode::kInvalidArgument, std::string("wrong loops: ") + why);
}

}  // namespace

double SquaredError(const PoseGraph& graph, const PoseGraphEdge& edge) {
  const bool is_planar = graph.dimension == 2;
  double inverse[7], motion[7], e[6] = {};
  (is_planar ? InvertPlanarPose : InvertPose)(graph.PoseData(edge.from), inverse);
  (is_planar ? ComposePlanarPoses : ComposePoses)(inverse, graph.PoseData(edge.to), motion);
  for (std::size_t k = 0; k < static_cast<std::size_t>(graph.dimension); ++k) {
    e[k] = motion[k] - edge.measurement[k];
  }
  if (is_planar) {
    e[2] = std::remainder(motion[2] - edge.measurement[2], 2.0 * M_PI);
  } else {
    double conjugate[4], q[4];
    ConjugateQuaternion(edge.measurement.data() + 3, conjugate);
    MultiplyQuaternions(conjugate, motion + 3, q);
    LogQuaternion(q, e + 3);
  }
  const auto size = static_cast<std::size_t>(graph.TangentSize());
  double sum = 0.0;
  for (std::size_t r = 0; r < size; ++r) {
    for (std::size_t c = 0; c < size; ++c) {
      sum += e[r] * edge.information[r * size + c] * e[c];
    }
  }
  return sum;
}

Status AddWrongLoops(const WrongLoopOptions& options, const PoseGraph& reference,
                     PoseGraph* graph) {
  if (!(options.fraction >= 0.0 && options.fraction < 1.0)) {
    return NoLoops("their fraction must be at least 0 and less than 1");
  }
  if (options.fraction == 0.0) {
    return Status::Ok();
  }
  LoopDealer dealer(options, reference, *graph);
  if (dealer.num_loops() == 0) {
    return NoLoops("the graph has no loops to take their measurements from");
  }
  const double count = std::round(options.fraction / (1.0 - options.fraction) *
                                  static_cast<double>(dealer.num_loops()));
  std::vector<PoseGraphEdge> wrong(static_cast<std::size_t>(count));
  for (PoseGraphEdge& edge : wrong) {
    if (!dealer.Draw(&edge)) {
      return NoLoops("no pair of vertices is left that one would be wrong for");
    }
  }
  graph->edges.insert(graph->edges.end(), wrong.begin(), wrong.end());
  return Status::Ok();
}

}  // namespace inceres::tools
