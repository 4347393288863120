#include "linearize/layout.h"

#include <algorithm>

#include "simd/kernels.h"

namespace inceres::internal {

// The order of unknowns. Frames by id; landmarks by first appearance among the factors. The order
// decides the order of all sums over variables, and follows from the graph alone.

Layout::Layout(const FactorGraph& graph, bool eliminate_landmarks) {
  // Variables that no factor touches take no part, as in Ceres's reduced program.
  std::vector<char> touched(graph.num_variables(), 0);
  std::vector<VariableId> landmarks;
  variables.reserve(graph.num_variables());
  // Landmarks in the order in which factors meet them: neighbors in memory are then used together.
  for (FamilyId f = 0; f < graph.num_families(); ++f) {
    const auto num_entries =
        static_cast<std::int64_t>(graph.NumFactors(f)) * graph.family(f).num_slots();
    const VariableId* ids = num_entries > 0 ? graph.Variables(f, 0) : nullptr;
    for (std::int64_t k = 0; k < num_entries; ++k) {
      const VariableId id = ids[k];
      if (id < 0) {
        continue;  // a free place
      }
      // Constants are marked as touched and have no place.
      char& seen = touched[id];
      // A constant landmark is none: it has no columns.
      if (seen == 0 && eliminate_landmarks && graph.role(id) == Role::kLandmark &&
          !graph.IsConstant(id)) {
        landmarks.push_back(id);
      }
      seen = 1;
    }
  }
  // Without elimination landmarks are frames like others, by id.
  for (VariableId id = 0; id < graph.num_variables(); ++id) {
    const bool is_frame = !eliminate_landmarks || graph.role(id) == Role::kFrame;
    if (touched[id] != 0 && is_frame && !graph.IsConstant(id)) {
      variables.push_back(id);
    }
  }
  num_frames = static_cast<int>(variables.size());
  variables.insert(variables.end(), landmarks.begin(), landmarks.end());

  // Offsets have one entry more than variables, so that sizes are differences.
  position.assign(graph.num_variables(), -1);
  packed_offset.reserve(variables.size() + 1);
  quad_offset.reserve(variables.size() + 1);
  packed_offset.push_back(0);
  quad_offset.push_back(0);
  for (std::size_t i = 0; i < variables.size(); ++i) {
    const int size = graph.TangentSize(variables[i]);
    position[variables[i]] = static_cast<int>(i);
    packed_offset.push_back(packed_offset.back() + size);
    // Kernels load quads: every variable begins at one.
    quad_offset.push_back(quad_offset.back() + PadToQuad(size) / kQuad);
  }
}

// Padding is not written: the caller's zeros stay.
void Layout::Pad(const double* packed, int begin, int end, double* padded) const {
  for (int i = begin; i < end; ++i) {
    const double* from = packed + packed_offset[i];
    std::copy(from, packed + packed_offset[i + 1],
              padded + static_cast<std::int64_t>(quad_offset[i]) * kQuad);
  }
}

}  // namespace inceres::internal
