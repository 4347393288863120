#pragma once

#include <cstdint>
#include <vector>

#include "adapters/ceres/src/factor_shapes.h"
#include "adapters/ceres/src/introspection.h"
#include "adapters/ceres/src/landmark_selection.h"
#include "inceres/graph/factor_graph.h"

namespace inceres::internal {

/// Where a parameter block of the user's lies in the graph's state vector.
struct StateBlock {
  double* user = nullptr;
  std::int64_t offset = 0;
  int size = 0;
};

/// Adds to an empty graph the blocks the solver moves (frames, then landmarks, both in order of first appearance, so that nothing
/// depends on addresses), the constants they meet (borrowed), and the residual blocks, one family for each shape and landmark
/// slot, the factors of one landmark next to each other.
///
/// Returns where each moved block lies. The graph borrows cost functions, losses, manifolds and constants. Cost: linear.
std::vector<StateBlock> BuildGraph(const ProblemView& view, const ShapeTable& shapes, const LandmarkSelection& landmarks,
                                   FactorGraph* graph);

/// user memory := state, for every block the solver moves and nothing else.
void WriteToUser(const std::vector<StateBlock>& blocks, const double* state);

}  // namespace inceres::internal
