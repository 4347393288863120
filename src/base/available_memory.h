#pragma once

#include <functional>

#include "inceres/export.h"

namespace inceres::internal {

/// Bytes that may still be taken; null: as many as one likes.
using AvailableMemory = std::function<double()>;

/// Bytes that this process may still take: the least of what the machine has left, what its control
/// group (version 2) allows and what RLIMIT_AS does; infinite where none of them is known. Cost:
/// some tens of microseconds.
INCERES_EXPORT double AvailableBytes();

}  // namespace inceres::internal
