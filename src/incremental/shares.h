#pragma once

#include "inceres/solver/incremental_options.h"

namespace inceres::internal {

/// The shares of IncrementalOptions, with IncrementalOptions::kByGraph resolved. Under
/// RelinearizationRule::kStepSize the first only says on what convergence may rest, whatever the
/// graph.
struct Shares {
  double relinearization = 0.0;
  double truncation = 0.0;
};

inline Shares SharesOf(const IncrementalOptions& options, int num_landmarks) {
  const auto resolve = [](double share, double by_graph) {
    return share == IncrementalOptions::kByGraph ? by_graph : share;
  };
  const bool by_error = options.relinearization == RelinearizationRule::kResidualError;
  return {resolve(options.relinearization_share, num_landmarks > 0 || !by_error ? 0.1 : 0.003),
          resolve(options.truncation_share, num_landmarks > 0 ? 0.03 : 0.0)};
}

}  // namespace inceres::internal
