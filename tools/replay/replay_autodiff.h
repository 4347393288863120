#pragma once

#include <memory>

#include <ceres/cost_function.h>

#include "tools/replay/replay_step.h"

namespace inceres::tools {

/// The factor as an AutoDiff cost function; `first` is the kind of its first variable. Null for
/// factors that have none: visual-inertial ones, and priors of a shape that no replay has so far.
std::unique_ptr<ceres::CostFunction> MakeAutoDiffCost(const ReplayFactor& factor,
                                                      ReplayVariable::Kind first);

}  // namespace inceres::tools
