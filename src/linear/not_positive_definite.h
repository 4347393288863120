#pragma once

#include <cstddef>
#include <cstdlib>
#include <string>

#include "inceres/status.h"

namespace inceres::internal {

constexpr const char kTextAtFrame[] = "the reduced system is not positive definite at frame ";

/// What all solvers of S say of a pivot that is not positive: kSingular, and the frame whose block
/// row of S it is in.
inline Status NotPositiveDefinite(int frame) {
  return Status::Error(StatusCode::kSingular, kTextAtFrame + std::to_string(frame));
}

/// The same in words of the graph, which knows frames by id_of(frame); any other status as it is.
template <typename IdOf>
Status NameVariable(Status status, const IdOf& id_of) {
  constexpr std::size_t kLength = sizeof(kTextAtFrame) - 1;
  if (status.code == StatusCode::kSingular &&
      status.message.compare(0, kLength, kTextAtFrame) == 0) {
    const int frame = std::atoi(status.message.c_str() + kLength);
    status.message = "the reduced system is not positive definite at variable " +
                     std::to_string(id_of(static_cast<std::size_t>(frame)));
  }
  return status;
}

}  // namespace inceres::internal
