#pragma once

#include <string>

#include "inceres/export.h"
#include "inceres/solver/summary.h"

namespace inceres::internal {

/// Parts of a Summary, each as one JSON object with every field.
INCERES_EXPORT std::string ToJson(const StageSeconds& seconds);
INCERES_EXPORT std::string ToJson(const WorkCounts& work);

}  // namespace inceres::internal
