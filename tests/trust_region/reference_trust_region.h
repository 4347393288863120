#pragma once

#include <vector>

#include "inceres/problem/factor_graph.h"
#include "inceres/solver/options.h"
#include "inceres/solver/summary.h"

namespace inceres::test {

/// Ceres 2.1's trust-region loop written down literally — scaled Jacobian, dense QR of stacked
/// rows, one big matrix — as an oracle for the core, which never scales J and never sees the whole
/// of it. Shares no code with src/. Handles what tests ask of it: both strategies, non-monotone
/// steps, tolerances and the iteration limit; every evaluation must succeed.
struct ReferenceTrace {
  std::vector<IterationSummary> iterations;  // cost, successful, radius, relative decrease, norms
  Termination termination = Termination::kNoConvergence;
  std::vector<double> state;  // what a solve returns
};

/// The solve starts at graph.state(); the graph is a scratch copy and ends at the last point
/// evaluated.
ReferenceTrace RunReference(const SolverOptions& options, const std::vector<VariableId>& variables,
                            FactorGraph graph);

}  // namespace inceres::test
