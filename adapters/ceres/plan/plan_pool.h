#pragma once

#include <cstddef>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "adapters/ceres/plan/graph_plan.h"
#include "adapters/ceres/plan/problem_structure.h"
#include "adapters/ceres/plan/solve_input.h"
#include "adapters/ceres/read/introspection.h"
#include "adapters/ceres/read/ordering.h"

namespace inceres::internal {

/// Plans of the small problems solved last, for those of the same structure that are built anew. A plan is found by content: all
/// numbers it was made of are compared. Guarded: concurrent solves share the plans, which nobody changes.
class PlanPool {
 public:
  static constexpr std::size_t kMaxPlans = 4;
  /// Residual blocks and slots of a problem whose plan is kept: beyond them planning is a small share, and memory worth more.
  static constexpr std::size_t kMaxNumbers = 16384;

  /// The process's. Never destroyed, as SolverPool's.
  static PlanPool& Global();

  /// The plan for this problem and effective linear solver: one that was kept or else a new one, which is then kept in place of
  /// the one that has waited longest.
  std::shared_ptr<const GraphPlan> Get(const ProblemView& view, const OrderingView& ordering, ceres::LinearSolverType type);

  void Clear();

 private:
  struct Entry {
    ProblemStructure structure;
    GraphPlan plan;
  };

  std::shared_ptr<const GraphPlan> Find(const ProblemView& view, const OrderingView& ordering, ceres::LinearSolverType type);
  void Keep(std::shared_ptr<const Entry> entry);

  std::mutex mutex_;
  std::vector<std::shared_ptr<const Entry>> entries_;  // the one used last at the end
};

/// Chooses the input's plan from the pool, where there is anything to solve for. Returns what forbids it, or nothing.
std::string ChoosePlan(ceres::LinearSolverType type, SolveInput* input);

}  // namespace inceres::internal
