#pragma once

#include <string>

#include "inceres/export.h"

namespace inceres::internal {

/// The processor's name as the system tells it, "unknown" if it does not.
INCERES_EXPORT std::string CpuModel();

}  // namespace inceres::internal
