#include "inceres/io/bal_graph.h"

#include <cstddef>
#include <utility>

#include "io/capped_count.h"

// A BAL problem as a factor graph: cameras are frames of nine Euclidean coordinates, points are
// landmarks (the variables that the Schur complement eliminates), observations are factors of one
// family. The order is that of the file, and ids follow from it, so a problem that is read twice
// gives the same sums in the same order.

namespace inceres {

BalGraph AddBal(const BalProblem& bal, const std::shared_ptr<const Loss>& loss,
                FactorGraph* graph) {
  BalGraph ids;
  // The state is one array: it would be copied several times while it grows.
  graph->Reserve(
      graph->num_variables() + bal.num_cameras + bal.num_points,
      internal::CappedCount(graph->state().size() + bal.cameras.size() + bal.points.size()));
  for (int i = 0; i < bal.num_cameras; ++i) {
    ids.cameras.push_back(
        graph->AddVariable(bal.CameraData(i), BalProblem::kCameraSize, Role::kFrame));
  }
  for (int i = 0; i < bal.num_points; ++i) {
    ids.points.push_back(
        graph->AddVariable(bal.PointData(i), BalProblem::kPointSize, Role::kLandmark));
  }
  // By VariableId: the graph may have had variables before.
  std::vector<char> observed(static_cast<std::size_t>(graph->num_variables()), 0);
  // Both slots Euclidean: nine and three coordinates.
  ids.reprojections = graph->AddFamily(std::make_shared<BalReprojectionFamily>());
  ids.reprojections->Reserve(bal.observations.size());
  for (const BalObservation& observation : bal.observations) {
    const VariableId variables[] = {ids.cameras[static_cast<std::size_t>(observation.camera)],
                                    ids.points[static_cast<std::size_t>(observation.point)]};
    // A family's measurements and the graph's factors of it are numbered alike: one Connect for
    // each Add, in the same order.
    ids.reprojections->Add({observation.x, observation.y});
    graph->Connect(ids.reprojections, variables, loss);
    for (const VariableId variable : variables) {
      observed[static_cast<std::size_t>(variable)] = 1;
    }
  }
  // What nothing observes has a zero block on the diagonal of H; held constant it stays out of the
  // system, and keeps its values.
  for (const std::vector<VariableId>* added : {&ids.cameras, &ids.points}) {
    for (const VariableId id : *added) {
      graph->SetConstant(id, observed[static_cast<std::size_t>(id)] == 0);
    }
  }
  return ids;
}

// Nothing is added before all of the file has been read and checked.
Status ReadBal(const std::string& path, FactorGraph* graph, BalGraph* ids,
               const GraphReadOptions& options) {
  BalProblem bal;
  Status status = ReadBal(path, &bal, nullptr, options.file);
  // The reader has checked each number by itself; this checks what AddBal requires, whichever
  // reader it was.
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
