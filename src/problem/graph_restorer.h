#pragma once

#include <cstdint>
#include <map>
#include <vector>

#include "inceres/problem/factor_graph.h"

namespace inceres::internal {

/// All that a graph is, as it is kept in a file: with the ids and places that are free, which no
/// public call can make.
struct GraphParts {
  std::vector<VariableRecord> variables;  // all owned
  std::vector<double> state;
  std::map<VariableId, VariableBounds> bounds;
  std::map<VariableId, std::vector<double>> pins;
  std::map<VariableId, std::int32_t> groups;  // of those in another one than 0
  std::vector<VariableId> free_variables;     // those of one size: the last one is given out first
  std::vector<FamilyRecord> families;         // without states of places and generations
};

/// Makes a graph of parts that may be anything.
class INCERES_EXPORT GraphRestorer {
 public:
  /// kInvalidArgument, graph unchanged, for parts that do not fit together, or that
  /// FactorGraph::Validate refuses. Edits that were begun on the graph are refused from then on.
  static Status Restore(GraphParts parts, FactorGraph* graph);

 private:
  static Status RestoreFamily(FamilyRecord family, FactorGraph* graph);
};

}  // namespace inceres::internal
