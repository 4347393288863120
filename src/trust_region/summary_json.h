#pragma once

#include <string>

#include "inceres/solver/summary.h"

namespace inceres::internal {

/// Parts of a Summary, each as one JSON object with every field.
std::string ToJson(const StageSeconds& seconds);
std::string ToJson(const WorkCounts& work);

}  // namespace inceres::internal
