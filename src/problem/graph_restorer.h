#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <vector>

#include "inceres/problem/factor_graph.h"

namespace inceres::internal {

/// All that a graph is, as it is kept in a file: with the ids and places that are free, which no
/// public call can make.
struct GraphParts {
  struct Variable {
    int ambient_size = 0;
    Role role = Role::kFrame;
    bool constant = false;
    bool removed = false;
    std::shared_ptr<const Manifold> manifold;
  };
  struct Family {
    std::shared_ptr<const FactorFamily> family;
    std::int64_t num_factors = 0;                     // places
    std::vector<VariableId> variables;                // −1 at free places
    std::vector<std::shared_ptr<const Loss>> losses;  // none, or one a place
    std::vector<std::int32_t> free_places;            // the last one is given out first
  };
  std::vector<Variable> variables;
  std::vector<double> state;
  std::map<VariableId, VariableBounds> bounds;
  std::map<VariableId, std::vector<double>> pins;
  std::map<VariableId, std::int32_t> groups;  // of those in another one than 0
  std::vector<VariableId> free_variables;     // those of one size: the last one is given out first
  std::vector<Family> families;
};

/// Makes a graph of parts that may be anything.
class INCERES_EXPORT GraphRestorer {
 public:
  /// kInvalidArgument, graph unchanged, for parts that do not fit together, or that
  /// FactorGraph::Validate refuses. Edits that were begun on the graph are refused from then on.
  static Status Restore(GraphParts parts, FactorGraph* graph);

 private:
  static Status RestoreVariables(const GraphParts& parts, VariableTable* variables);
  static Status RestoreFree(const std::vector<VariableId>& free, VariableTable* variables);
  static Status RestoreSettings(GraphParts* parts, VariableTable* variables);
  static Status RestoreFamily(GraphParts::Family family, FactorGraph* graph);
};

}  // namespace inceres::internal
