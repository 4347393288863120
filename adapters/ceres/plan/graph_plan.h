#pragma once

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

}  // namespace inceres::internal
