#pragma once

#include <string>

#include <ceres/evaluation_callback.h>

#include "adapters/ceres/read/introspection.h"

namespace inceres::internal {

/// The part of the cost that cannot move.
struct FixedCost {
  /// ½ Σ ρ over the residual blocks that touch no variable block; up to the failure, if one failed
  double cost = 0.0;
  std::string error;  ///< Ceres's message if a residual block could not be evaluated, else empty
};

/// Evaluates, in program order and without Jacobians, the residual blocks all of whose parameter
/// blocks are constant. `callback`, if given, is prepared once, before the first of them.
FixedCost EvaluateFixedCost(const ProblemView& view, ceres::EvaluationCallback* callback);

}  // namespace inceres::internal
