#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "adapters/ceres/plan/landmark_selection.h"
#include "adapters/ceres/read/factor_shapes.h"
#include "adapters/ceres/read/introspection.h"
#include "inceres/problem/factor_graph.h"
#include "src/base/aligned_vector.h"

namespace inceres::internal {

/// Which block and which residual block of a problem stand where in its graph. Numbers only,
/// nothing of the user's, so that it serves every problem of the same structure.
///
/// Variables are the blocks that residual blocks touch: constants and frames, then landmarks, both
/// in order of first appearance, so that nothing depends on addresses; where the selection orders
/// frames, these first, in that order. There is one family for each
/// shape and landmark slot, the factors of one landmark next to each other.
struct GraphPlan {
  struct Family {
    FactorShape shape;
    UnwrittenVector<int> residuals;     ///< residual block of each factor
    std::vector<VariableId> variables;  ///< of each factor and slot
  };

  LandmarkSelection landmarks;
  std::vector<int> blocks;  ///< parameter block of each variable
  std::vector<Family> families;
};

/// Makes a family of the cost functions of one of the plan's.
using MakeFamily = std::function<std::shared_ptr<const FactorFamily>(const ProblemView&,
                                                                     const GraphPlan::Family&)>;

/// Cost: linear in slots, most of it shared among threads.
GraphPlan PlanGraph(const ProblemView& view, const ShapeTable& shapes, LandmarkSelection landmarks,
                    int num_threads = 1);

/// Where a parameter block of the user's lies in the graph's state vector.
struct StateBlock {
  double* user = nullptr;
  std::int64_t offset = 0;
  int size = 0;
};

/// Adds to an empty graph what the plan says: the blocks the solver moves, the constants they meet
/// (borrowed), and the residual blocks. The plan is one of a problem of this structure.
///
/// Returns where each moved block lies. `make_family`, if set, makes the families. The graph
/// borrows cost functions, losses, manifolds and constants. Cost: linear, that of looking up cost
/// functions shared among threads.
std::vector<StateBlock> BuildGraph(const ProblemView& view, const GraphPlan& plan,
                                   FactorGraph* graph, const MakeFamily& make_family = nullptr,
                                   int num_threads = 1);

/// Has the graph's messages name variables by the parameter blocks they stand for. `blocks` is
/// BuildGraph's and outlives the graph's solves.
void NameVariables(const std::vector<StateBlock>& blocks, FactorGraph* graph);

/// user memory := state, for every block the solver moves and nothing else.
void WriteToUser(const std::vector<StateBlock>& blocks, const double* state);

}  // namespace inceres::internal
