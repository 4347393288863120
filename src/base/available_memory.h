#pragma once

#include <functional>
#include <string>

#include "inceres/export.h"

namespace inceres::internal {

/// Bytes that may still be taken; null: as many as one likes.
using AvailableMemory = std::function<double()>;

/// Bytes that this process may still take: the least of what the machine has left, what its control
/// groups (version 2) allow, its own and those around it, and what RLIMIT_AS does; infinite where
/// none of them is known. Cost: some tens of microseconds.
INCERES_EXPORT double AvailableBytes();

/// What the control groups alone allow: the group that `membership`, a file like
/// /proc/self/cgroup, names, and all around it up to the one at `root`, the folder where groups
/// are, /sys/fs/cgroup.
double LeftOfControlGroups(const std::string& membership, const std::string& root);

}  // namespace inceres::internal
