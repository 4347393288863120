#pragma once

#include <memory>
#include <string>
#include <vector>

#include "inceres/export.h"
#include "inceres/factors/bal_reprojection.h"
#include "inceres/io/bal.h"
#include "inceres/io/read_options.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/status.h"

namespace inceres {

/// Which variables of a graph a BAL problem has become.
struct BalGraph {
  FamilyHandle<BalReprojectionFamily> reprojections;  ///< of the observations
  std::vector<VariableId> cameras;                    ///< by the number in the file
  std::vector<VariableId> points;                     ///< the same
};

/// Adds the cameras (frames), points (landmarks) and observations of a problem to a graph, in the
/// order of the problem. What nothing observes is held constant. Requires bal.Validate().ok().
/// Cost: one pass over the problem. Threads: one writer.
INCERES_EXPORT BalGraph AddBal(const BalProblem& bal, const std::shared_ptr<const Loss>& loss,
                               FactorGraph* graph);

/// Reads a BAL file into a graph: ReadBal, then AddBal. `ids`, if not null, is filled. On an error,
/// which is that of ReadBal or of BalProblem::Validate, graph and ids are unchanged.
INCERES_EXPORT Status ReadBal(const std::string& path, FactorGraph* graph, BalGraph* ids = nullptr,
                              const GraphReadOptions& options = GraphReadOptions());

}  // namespace inceres
