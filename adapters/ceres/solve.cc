#include "inceres/ceres/solve.h"

#include <memory>
#include <string>
#include <utility>

#include "adapters/ceres/compare/cross_check.h"
#include "adapters/ceres/exact/exact_solve.h"
#include "adapters/ceres/fallback/gate.h"
#include "adapters/ceres/plan/option_mapping.h"
#include "adapters/ceres/plan/structure_cache.h"
#include "adapters/ceres/read/ceres_version.h"
#include "adapters/ceres/read/introspection.h"
#include "adapters/ceres/read/ordering.h"
#include "adapters/ceres/read/selection.h"
#include "adapters/ceres/session/incremental_solve.h"
#include "inceres/ceres/session.h"
#include "src/base/stopwatch.h"

namespace inceres {
namespace {

// By the core. Returns what forbids it, or nothing when it has solved.
std::string SolveByCore(const internal::SolveCall& call, bool incremental,
                        internal::SolveInput* input) {
  IncrementalOptions core;
  if (incremental) {
    core = internal::IncrementalOptionsFor(*input, IncrementalOptions());
  }
  if (incremental && core.batch_share >= 1.0) {  // not the batch solver's (IncrementalOptionsFor)
    internal::IncrementalProblem living(core, internal::Trust::kNothing);
    internal::SolveIncrementally(*input, core, &living, call.summary, call.report);
    return "";
  }
  const ceres::LinearSolverType type =
      incremental ? internal::TypeToPlanIncrementally(call.options, input->ordering)
                  : internal::TypeToPlanFor(call.options, input->ordering);
  std::string too_much = internal::ChoosePlan(type, input);
  if (!too_much.empty()) {
    return too_much;
  }
  if (incremental) {
    internal::SolveIncrementally(*input, core, nullptr, call.summary, call.report);
  } else {
    internal::SolveExactly(*input, call.summary, call.report);
  }
  return "";
}

void SolveOnce(const internal::SolveCall& call) {
  const double began = internal::NowInSeconds();
  const auto& [options, problem, summary, solve_options, report] = call;
  if (solve_options.mode == SolveMode::kStock) {
    report->used_stock = true;
    report->fallback_reason = "SolveMode::kStock was asked for";
    internal::SolveWithStock(options, problem, summary);
    return;
  }
  ceres::EvaluationCallback* const callback =
      internal::EvaluationCallbackOf(*problem, solve_options.evaluation_callback);
  std::unique_ptr<internal::ProblemView> view_memory =
      internal::StructureCache::OfProcess().TakeView();
  internal::ProblemView& view = *view_memory;
  internal::OrderingView ordering;
  const std::string obstacle = internal::FindObstacle(
      options, solve_options.mode == SolveMode::kIncremental, callback,
      [&] {
        internal::Introspect(*call.problem, &view, internal::NumReaders(call.options),
                             !call.solve_options.problem_has_no_bounds);
      },
      view, &ordering, &report->exact_reason);
  const bool incremental =
      solve_options.mode == SolveMode::kIncremental && report->exact_reason.empty();
  if (!obstacle.empty()) {
    internal::Decline(call, obstacle);
    return;
  }
  if (incremental && internal::HasBounds(view)) {
    // A session finishes what incremental steps have not, for the batch solver does not begin here.
    // It looks at the problem by itself.
    internal::StructureCache::OfProcess().GiveBack(std::move(view_memory));
    internal::SolveOnceInSession(call);
    return;
  }
  internal::SolveInput input{options, view, ordering, began, callback, solve_options};
  const std::string too_much = SolveByCore(call, incremental, &input);
  if (!too_much.empty()) {
    internal::Decline(call, too_much);
    return;
  }
  internal::StructureCache::OfProcess().GiveBack(
      std::move(view_memory));  // not if something was thrown on the way
}

}  // namespace

void Solve(const ceres::Solver::Options& options, ceres::Problem* problem,
           ceres::Solver::Summary* summary, const SolveOptions& solve_options,
           SolveReport* report) {
  internal::SolveAsAsked({options, problem, summary, solve_options, report}, SolveOnce,
                         internal::Repeatable::kYes);
}

void ForgetStructures() {
  internal::StructureCache::OfProcess().Clear();
}

}  // namespace inceres
