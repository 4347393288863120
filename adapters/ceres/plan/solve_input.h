#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <optional>

#include <ceres/evaluation_callback.h>
#include <ceres/solver.h>

#include "adapters/ceres/plan/graph_plan.h"
#include "adapters/ceres/read/introspection.h"
#include "adapters/ceres/read/ordering.h"
#include "adapters/ceres/read/user_state.h"
#include "inceres/ceres/solve.h"

namespace inceres::internal {

/// Wall time since construction.
class WallClock {
 public:
  double Seconds() const {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

/// A problem that passed the gate.
struct SolveInput {
  const ceres::Solver::Options& options;
  ProblemView& view;  ///< a solver may give back what it no longer needs of it
  const OrderingView& ordering;
  const WallClock& clock;  ///< started with the solve
  /// of the problem, if Ceres shows it or the caller told
  ceres::EvaluationCallback* evaluation_callback = nullptr;
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
  /// Asked at the end of each iteration, after all callbacks: whether the solve is to be aborted.
  /// May be empty.
  std::function<bool()> is_to_abort = nullptr;
  MakeFamily make_family = nullptr;     ///< if set, makes the families of the graph
  const SolveOptions* asked = nullptr;  ///< what the caller has asked for; null: nothing
};

}  // namespace inceres::internal
