#include "inceres/ceres/solve.h"

#include <memory>
#include <string>
#include <utility>

#include <glog/logging.h>

#include "adapters/ceres/compare/cross_check.h"
#include "adapters/ceres/exact/exact_solve.h"
#include "adapters/ceres/fallback/decline.h"
#include "adapters/ceres/fallback/gate.h"
#include "adapters/ceres/fallback/stock_ceres.h"
#include "adapters/ceres/plan/iterative_choice.h"
#include "adapters/ceres/plan/option_mapping.h"
#include "adapters/ceres/plan/plan_pool.h"
#include "adapters/ceres/plan/view_pool.h"
#include "adapters/ceres/read/ceres_version.h"
#include "adapters/ceres/read/introspection.h"
#include "adapters/ceres/read/ordering.h"
#include "adapters/ceres/session/incremental_solve.h"

namespace inceres {
namespace {

void SolveOnce(const ceres::Solver::Options& options, ceres::Problem* problem, ceres::Solver::Summary* summary, SolveMode mode,
               SolveReport* report) {
  const internal::WallClock clock;
  if (mode == SolveMode::kStock) {
    report->used_stock = true;
    report->fallback_reason = "SolveMode::kStock was asked for";
    internal::SolveWithStock(options, problem, summary);
    return;
  }
  const bool incremental = mode == SolveMode::kIncremental;
  ceres::EvaluationCallback* const callback =
      internal::EvaluationCallbackOf(*problem, report != nullptr ? report->evaluation_callback : nullptr);
  std::unique_ptr<internal::ProblemView> view_memory = internal::ViewPool::Global().Take();
  internal::ProblemView& view = *view_memory;
  internal::OrderingView ordering;
  const std::string obstacle = internal::FindObstacle(options, *problem, incremental, callback, &view, &ordering);
  if (!obstacle.empty()) {
    internal::Decline(options, problem, summary, obstacle, report);
    return;
  }
  internal::SolveInput input{options, view, ordering, clock, callback};
  IncrementalOptions core;
  if (incremental) {
    core = internal::MapIncrementalOptions(options, IncrementalOptions());
    internal::ChooseIterativeSolver(options, view, ordering, internal::kMaxDirectSize, &core);
  }
  if (incremental && core.batch_share >= 1.0) {  // the batch solver's solvers are direct
    internal::IncrementalProblem living(core, internal::Trust::kNothing);
    internal::SolveIncrementally(input, core, &living, summary, report);
  } else {
    const ceres::LinearSolverType type =
        incremental ? internal::IncrementalLinearSolver(options, ordering) : internal::TypeToPlanFor(options, ordering);
    const std::string too_much = internal::ChoosePlan(type, &input);
    if (!too_much.empty()) {
      internal::Decline(options, problem, summary, too_much, report);
      return;
    }
    if (incremental) {
      internal::SolveIncrementally(input, core, nullptr, summary, report);
    } else {
      internal::SolveExactly(input, summary, report);
    }
  }
  internal::ViewPool::Global().GiveBack(std::move(view_memory));  // not if something was thrown on the way
}

}  // namespace

void Solve(const ceres::Solver::Options& options, ceres::Problem* problem, ceres::Solver::Summary* summary, SolveReport* report) {
  CHECK(problem != nullptr);  // as ceres::Solve
  CHECK(summary != nullptr);
  *summary = ceres::Solver::Summary();
  const SolveMode mode = report != nullptr ? report->mode : SolveMode::kExact;
  internal::ClearResults(report);
  if (internal::WantsComparison(report)) {
    const auto once = [&] { SolveOnce(options, problem, summary, mode, report); };
    const auto again = [&](const ceres::Solver::Options& quiet, ceres::Solver::Summary* second) {
      SolveReport unread;
      unread.strict = true;
      SolveOnce(quiet, problem, second, mode, &unread);
    };
    internal::SolveAndCompare(options, problem, summary, report, mode, {once, again});
  } else {
    SolveOnce(options, problem, summary, mode, report);
  }
}

}  // namespace inceres
