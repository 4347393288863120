#include "inceres/io/bal_graph.h"

#include <cstddef>
#include <utility>

namespace inceres {

BalGraph AddBal(const BalProblem& bal, const std::shared_ptr<const Loss>& loss,
                FactorGraph* graph) {
  BalGraph ids;
  graph->Reserve(graph->num_variables() + bal.num_cameras + bal.num_points,
                 static_cast<int>(graph->state().size() + bal.cameras.size() + bal.points.size()));
  for (int i = 0; i < bal.num_cameras; ++i) {
    ids.cameras.push_back(
        graph->AddVariable(bal.CameraData(i), BalProblem::kCameraSize, Role::kFrame));
  }
  for (int i = 0; i < bal.num_points; ++i) {
    ids.points.push_back(
        graph->AddVariable(bal.PointData(i), BalProblem::kPointSize, Role::kLandmark));
  }
  std::vector<char> observed(static_cast<std::size_t>(graph->num_variables()), 0);
  ids.reprojections = graph->AddFamily(std::make_shared<BalReprojectionFamily>());
  ids.reprojections->Reserve(static_cast<int>(bal.observations.size()));
  for (const BalObservation& observation : bal.observations) {
    const VariableId variables[] = {ids.cameras[static_cast<std::size_t>(observation.camera)],
                                    ids.points[static_cast<std::size_t>(observation.point)]};
    ids.reprojections->Add({observation.x, observation.y});
    graph->Connect(ids.reprojections, variables, loss);
    for (const VariableId variable : variables) {
      observed[static_cast<std::size_t>(variable)] = 1;
    }
  }
  for (const std::vector<VariableId>* added : {&ids.cameras, &ids.points}) {
    for (const VariableId id : *added) {
      graph->SetConstant(id, observed[static_cast<std::size_t>(id)] == 0);
    }
  }
  return ids;
}

Status ReadBal(const std::string& path, FactorGraph* graph, BalGraph* ids,
               const GraphReadOptions& options) {
  BalProblem bal;
  Status status = ReadBal(path, &bal, nullptr, options.file);
  status = status.ok() ? bal.Validate() : status;
  if (status.ok()) {
    BalGraph added = AddBal(bal, options.loss, graph);
    if (ids != nullptr) {
      *ids = std::move(added);
    }
  }
  return status;
}

}  // namespace inceres
