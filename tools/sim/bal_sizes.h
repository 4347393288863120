#pragma once

#include <cstdint>
#include <string>

#include "inceres/status.h"

namespace inceres::internal {

/// Ok if so many observations (0: the mean track length says how many) are possible, and are more
/// equations than there are unknowns; kInvalidArgument "`options`: …" if not.
Status CheckBalSizes(const char* options, std::int64_t num_cameras, std::int64_t num_points,
                     std::int64_t num_observations, double mean_track_length);

/// The N of a preset's name `prefix`N; kInvalidArgument unless it is a number from 1 on that an int
/// holds.
Status ParseSizedPreset(const std::string& name, const std::string& prefix, int* size);

}  // namespace inceres::internal
