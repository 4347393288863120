#pragma once

#include "incremental/incremental_system.h"

namespace inceres::internal {

/// All of its graph becomes part of a system that has none of it yet.
inline void AddWholeGraph(IncrementalSystem* system) {
  const FactorGraph& graph = system->graph();
  for (VariableId id = 0; id < graph.num_variables(); ++id) {
    if (graph.HasVariable(id)) {
      system->AddVariable(id);
    }
  }
  for (FamilyId family = 0; family < graph.num_families(); ++family) {
    for (int i = 0; i < graph.NumFactors(family); ++i) {
      if (graph.HasFactor(family, i)) {
        system->AddFactor({family, i});
      }
    }
  }
}

}  // namespace inceres::internal
