#pragma once

#include <chrono>

#include <ceres/solver.h>

#include "adapters/ceres/src/introspection.h"
#include "adapters/ceres/src/ordering.h"
#include "inceres/ceres/solve.h"

namespace inceres::internal {

/// Wall time since construction.
class WallClock {
 public:
  double Seconds() const { return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count(); }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

/// A problem that passed the gate, and where its results go. `report` may be null.
struct ExactSolveInput {
  const ceres::Solver::Options& options;
  const ProblemView& view;
  const OrderingView& ordering;
  const WallClock& clock;  ///< started with the solve
};

/// Solves with the core in exact mode: fixed cost, landmarks, graph, minimisation, write-back, summary. Writes user memory as
/// Ceres does: only blocks it moved, the best state if it is usable, else what was there before.
void SolveExactly(const ExactSolveInput& input, ceres::Solver::Summary* summary, SolveReport* report);

}  // namespace inceres::internal
