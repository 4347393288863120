#pragma once

#include <cstdint>
#include <vector>

#include "adapters/ceres/plan/graph_plan.h"
#include "adapters/ceres/read/introspection.h"
#include "inceres/problem/factor_graph.h"

namespace inceres::internal {

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
