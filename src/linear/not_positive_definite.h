#pragma once

#include <string>

#include "inceres/status.h"

namespace inceres::internal {

/// What all solvers of S say of a pivot that is not positive: kSingular, and the frame whose block
/// row of S it is in.
inline Status NotPositiveDefinite(int frame) {
  return Status::Error(
      StatusCode::kSingular,
      "the reduced system is not positive definite at frame " + std::to_string(frame));
}

}  // namespace inceres::internal
