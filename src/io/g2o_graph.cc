#include "inceres/io/g2o_graph.h"

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <numeric>
#include <utility>

#include "inceres/factors/pose_prior.h"
#include "inceres/problem/manifolds.h"
#include "inceres/problem/rotation.h"

namespace inceres {
namespace {

// The edges as measurements; all or, with the culprit's message, none.
template <typename Family>
Status Convert(const PoseGraph& poses, Family* family) {
  family->Reserve(static_cast<int>(poses.edges.size()));
  for (std::size_t i = 0; i < poses.edges.size(); ++i) {
    const PoseGraphEdge& edge = poses.edges[i];
    typename Family::Measurement measurement;
    if (!ToMeasurement(edge, &measurement)) {
      return Status::Error(StatusCode::kInvalidArgument,
                           "edge " + std::to_string(i) + ", from vertex " +
                               std::to_string(poses.ids[static_cast<std::size_t>(edge.from)]) +
                               " to " +
                               std::to_string(poses.ids[static_cast<std::size_t>(edge.to)]) +
                               ": the information matrix is not positive definite");
    }
    family->Add(measurement);
  }
  return Status::Ok();
}

}  // namespace

std::vector<int> VerticesById(const PoseGraph& poses) {
  std::vector<int> order(poses.ids.size());
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(), [&poses](int a, int b) {
    return poses.ids[static_cast<std::size_t>(a)] < poses.ids[static_cast<std::size_t>(b)];
  });
  return order;
}

std::vector<int> LoopEdges(const PoseGraph& poses) {
  const std::vector<int> order = VerticesById(poses);
  std::vector<int> position(order.size());
  for (std::size_t i = 0; i < order.size(); ++i) {
    position[static_cast<std::size_t>(order[i])] = static_cast<int>(i);
  }
  std::vector<int> loops;
  for (std::size_t i = 0; i < poses.edges.size(); ++i) {
    const int from = position[static_cast<std::size_t>(poses.edges[i].from)];
    const int to = position[static_cast<std::size_t>(poses.edges[i].to)];
    if (std::abs(from - to) != 1) {
      loops.push_back(static_cast<int>(i));
    }
  }
  return loops;
}

bool ToMeasurement(const PoseGraphEdge& edge, PlanarRelativePoseFamily::Measurement* measurement) {
  std::copy_n(edge.measurement.begin(), 3, measurement->motion);
  return SqrtInformation(edge.information.data(), 3, measurement->sqrt_information);
}

// RelativePoseFamily's a is the edge's `to`, its b `from`: then R_abᵀ is the measured rotation and
// p_ab the measured position. Its rotation residual, which comes first, is minus the rotation
// vector of q_m* q_from* q_to.
bool ToMeasurement(const PoseGraphEdge& edge, RelativePoseFamily::Measurement* measurement) {
  std::copy_n(edge.measurement.begin(), 3, measurement->p_ab);
  ConjugateQuaternion(edge.measurement.data() + 3, measurement->q_ab);
  double information[36];
  for (std::size_t r = 0; r < 6; ++r) {
    for (std::size_t c = 0; c < 6; ++c) {
      const double sign = (r < 3) == (c < 3) ? 1.0 : -1.0;
      information[6 * r + c] = sign * edge.information[6 * ((r + 3) % 6) + (c + 3) % 6];
    }
  }
  return SqrtInformation(information, 6, measurement->sqrt_information);
}

Status AddPoseGraph(const PoseGraph& poses, const std::shared_ptr<const Loss>& loss,
                    FactorGraph* graph, G2oGraph* ids) {
  const bool is_planar = poses.dimension == 2;
  const auto planar = std::make_shared<PlanarRelativePoseFamily>();
  const auto spatial = std::make_shared<RelativePoseFamily>();
  Status status = is_planar ? Convert(poses, planar.get()) : Convert(poses, spatial.get());
  if (!status.ok()) {
    return status;
  }
  G2oGraph added;
  const auto manifold = is_planar ? nullptr : std::make_shared<PoseManifold>();
  for (int i = 0; i < poses.NumVertices(); ++i) {
    added.poses.push_back(
        graph->AddVariable(poses.PoseData(i), poses.PoseSize(), Role::kFrame, manifold));
  }
  for (const int vertex : poses.fixed) {
    graph->SetConstant(added.poses[static_cast<std::size_t>(vertex)], true);
  }
  if (is_planar) {
    added.planar = graph->AddFamily(planar);
  } else {
    added.spatial = graph->AddFamily(spatial);
  }
  for (const PoseGraphEdge& edge : poses.edges) {
    const VariableId from = added.poses[static_cast<std::size_t>(edge.from)];
    const VariableId to = added.poses[static_cast<std::size_t>(edge.to)];
    const VariableId variables[] = {is_planar ? from : to, is_planar ? to : from};
    graph->Connect(is_planar ? added.planar.id : added.spatial.id, variables, loss);
  }
  if (ids != nullptr) {
    *ids = std::move(added);
  }
  return status;
}

Status ReadG2o(const std::string& path, FactorGraph* graph, G2oGraph* ids,
               const GraphReadOptions& options) {
  PoseGraph poses;
  const Status status = ReadG2o(path, &poses, options.file);
  if (!status.ok()) {
    return status;
  }
  Status added = AddPoseGraph(poses, options.loss, graph, ids);
  if (!added.ok()) {
    added.message = path + ": " + added.message;
  }
  return added;
}

}  // namespace inceres
