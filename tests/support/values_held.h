#pragma once

#include "inceres/solver/incremental_solver.h"

namespace inceres::test {

/// The solver's problem as it stands, as a graph by itself.
inline FactorGraph AtValuesHeld(const IncrementalSolver& solver) {
  FactorGraph graph = solver.graph();
  for (VariableId id = 0; id < graph.num_variables(); ++id) {
    if (graph.HasVariable(id)) {
      graph.SetValues(id, solver.Values(id));
    }
  }
  return graph;
}

}  // namespace inceres::test
