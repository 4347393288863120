#pragma once

#include <cstddef>
#include <string>

#include "inceres/linear/reduced_solver.h"
#include "inceres/status.h"

namespace inceres::internal {

/// What all solvers of S say of a pivot that is not positive: kSingular, and the frame whose block
/// row of S it is in, which goes into Work::failed_row.
inline Status NotPositiveDefinite(int frame, ReducedSolver::Work* work) {
  work->failed_row = frame;
  return Status::Error(
      StatusCode::kSingular,
      "the reduced system is not positive definite at frame " + std::to_string(frame));
}

/// What `solver` has returned from Factorize, in words of the graph where it knows the row: that
/// knows frames by id_of(row).
template <typename IdOf>
Status NameVariable(const ReducedSolver& solver, Status status, const IdOf& id_of) {
  const int row = solver.work().failed_row;
  if (status.code == StatusCode::kSingular && row >= 0) {
    status.message = "the reduced system is not positive definite at variable " +
                     std::to_string(id_of(static_cast<std::size_t>(row)));
  }
  return status;
}

}  // namespace inceres::internal
