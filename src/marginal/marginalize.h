#pragma once

#include <functional>

#include "inceres/problem/graph_edit.h"
#include "inceres/solver/marginalization.h"
#include "linearize/factor_linearizer.h"

namespace inceres::internal {

/// What Marginalize works on: a graph by itself, or one that a live solver keeps.
struct MarginalizationTarget {
  FactorGraph* graph = nullptr;
  FactorLinearizer::ValuesOf values;  // the current ones
  /// Rows that are known without an evaluation: true if it has set them. May be empty. wanted as
  /// for FactorLinearizer.
  std::function<bool(FactorId, const std::function<bool(VariableId)>& wanted, LinearizedFactor*)>
      cached;
  std::function<Status(const GraphEdit&)> apply;
};

MarginalizationSummary MarginalizeOn(const MarginalizationTarget& target,
                                     const MarginalizationRequest& request,
                                     const MarginalizationOptions& options);

}  // namespace inceres::internal
