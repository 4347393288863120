#pragma once

#include <string>
#include <vector>

#include <ceres/evaluation_callback.h>
#include <ceres/solver.h>

#include "adapters/ceres/plan/graph_plan.h"
#include "adapters/ceres/read/introspection.h"

namespace inceres::internal {

/// The groups of blocks that a solve with inner iterations moves one after the other.
struct InnerOrdering {
  std::vector<std::vector<int>> groups;  ///< of blocks of the view; empty: no inner iterations
  std::vector<int> group_sizes;          ///< as the summary tells them: of what was given or chosen
  std::string error;                     ///< Ceres's message where there is none of a valid kind
};

/// Ceres's: inner_iteration_ordering less what does not move, or independent sets of the blocks,
/// found one after the other, the last one first. Ties between blocks of as many neighbors are
/// broken by first appearance where Ceres breaks them by addresses of its own. Warns as Ceres does
/// where there are to be inner iterations and are none. The caller's ordering is only read. Cost:
/// linear in slots, times the number of groups if they are to be chosen.
InnerOrdering FindInnerOrdering(const ceres::Solver::Options& options,
                                const ceres::EvaluationCallback* evaluation_callback,
                                const ProblemView& view);

/// The same groups as variables of the graph.
std::vector<std::vector<VariableId>> GroupsInGraph(const InnerOrdering& ordering,
                                                   const GraphPlan& plan, std::size_t num_blocks);

}  // namespace inceres::internal
