#pragma once

#include <string>

namespace inceres::internal {

/// The processor's name as the system tells it, "unknown" if it does not.
std::string CpuModel();

}  // namespace inceres::internal
