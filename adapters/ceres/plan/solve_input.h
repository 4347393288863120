#pragma once

#include <memory>
#include <optional>

#include <ceres/evaluation_callback.h>
#include <ceres/solver.h>

#include "adapters/ceres/plan/graph_plan.h"
#include "adapters/ceres/read/introspection.h"
#include "adapters/ceres/read/ordering.h"
#include "adapters/ceres/read/user_state.h"
#include "inceres/ceres/solve.h"
#include "src/base/stopwatch.h"

namespace inceres::internal {

/// A problem that passed the gate.
struct SolveInput {
  const ceres::Solver::Options& options;
  ProblemView& view;  ///< a solver may give back what it no longer needs of it
  const OrderingView& ordering;
  double began;  ///< NowInSeconds() when the solve began
  /// of the problem, if Ceres shows it or the caller told
  ceres::EvaluationCallback* evaluation_callback;
  const SolveOptions& asked;  ///< what the caller has asked for
  /// The last iteration of the part of this solve that another solver did, where there is one: it
  /// is this one's start.
  std::optional<int> last_iteration = std::nullopt;
  /// What the user's memory is to show while this solver works, where that part has left other
  /// values there: put back once these are read. Null: what it shows.
  const StartValues* shown = nullptr;
  /// The cost of the fixed residual blocks, if that part has evaluated it.
  std::optional<double> fixed_cost = std::nullopt;
  /// ChoosePlan's; null in a session, and where there is nothing to solve for
  std::shared_ptr<const GraphPlan> plan = nullptr;
  /// The same, where nobody else has it: a solver may give back what it no longer needs of it.
  std::shared_ptr<GraphPlan> own_plan = nullptr;

  /// Wall time since the solve began.
  double Seconds() const { return NowInSeconds() - began; }
};

}  // namespace inceres::internal
