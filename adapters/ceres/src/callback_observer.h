#pragma once

#include <vector>

#include <ceres/solver.h>

#include "adapters/ceres/src/graph_builder.h"
#include "inceres/solver/solver.h"

namespace inceres::internal {

/// What Ceres does at the end of an iteration, in its order: copy the best state to the user's memory (if asked to), log the
/// progress row (unless silent), call the user's callbacks until one of them stops the solve.
class CallbackObserver : public SolveObserver {
 public:
  /// Borrows both for the length of a solve.
  CallbackObserver(const ceres::Solver::Options& options, const std::vector<StateBlock>& blocks)
      : options_(options), blocks_(blocks) {}

  ObserverAction EndOfIteration(const IterationSummary& iteration, const double* best_state) override;

 private:
  const ceres::Solver::Options& options_;
  const std::vector<StateBlock>& blocks_;
};

}  // namespace inceres::internal
