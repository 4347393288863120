#pragma once

#include <sstream>
#include <string>

#include "inceres/problem/factor_graph.h"

namespace inceres {

// All that can be seen of a graph, for tests of what must not have changed. Pointers are printed as
// such.
inline std::string Dump(const FactorGraph& graph) {
  std::ostringstream text;
  text.precision(17);
  text << "revision " << graph.revision() << ", live " << graph.num_live_variables() << ", factors "
       << graph.num_factors();
  for (VariableId id = 0; id < graph.num_variables(); ++id) {
    text << "\nvariable " << id << (graph.HasVariable(id) ? "" : " removed") << " sizes "
         << graph.AmbientSize(id) << ' ' << graph.TangentSize(id) << " role "
         << static_cast<int>(graph.role(id)) << " constant " << graph.IsConstant(id) << " manifold "
         << graph.manifold(id) << " group " << graph.elimination_group(id) << " offset "
         << graph.StateOffset(id);
    text << " borrowed " << (graph.StateOffset(id) < 0 ? graph.Values(id) : nullptr);
    for (int k = 0; graph.PinnedValues(id) != nullptr && k < graph.AmbientSize(id); ++k) {
      text << (k == 0 ? " pinned" : "") << ' ' << graph.PinnedValues(id)[k];
    }
  }
  text << "\nstate";
  for (const double value : graph.state()) {
    text << ' ' << value;
  }
  for (FamilyId id = 0; id < graph.num_families(); ++id) {
    text << "\nfamily " << id << " losses " << graph.HasLosses(id) << " free";
    for (int k = 0; graph.FreePlace(id, k) >= 0; ++k) {
      text << ' ' << graph.FreePlace(id, k);
    }
    for (int i = 0; i < graph.NumFactors(id); ++i) {
      text << "\n  " << graph.DescribeFactor(id, i) << (graph.HasFactor(id, i) ? "" : " removed")
           << " loss " << graph.loss(id, i);
    }
  }
  for (int size = 1; size <= 9; ++size) {
    for (const bool borrowed : {false, true}) {
      for (int k = 0; graph.FreeVariable(size, borrowed, k) >= 0; ++k) {
        text << "\nfree of size " << size << (borrowed ? " borrowed " : " ")
             << graph.FreeVariable(size, borrowed, k);
      }
    }
  }
  return text.str();
}

}  // namespace inceres
