#pragma once

#include <memory>

#include <ceres/loss_function.h>

#include "tools/problems/loss_spec.h"

namespace inceres::tools {

/// The loss as Ceres knows it; null for none.
std::unique_ptr<ceres::LossFunction> MakeCeresLoss(const LossSpec& spec);

}  // namespace inceres::tools
