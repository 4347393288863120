#include "inceres/ceres/solve.h"

#include <string>

#include <glog/logging.h>

#include "adapters/ceres/src/decline.h"
#include "adapters/ceres/src/exact_solve.h"
#include "adapters/ceres/src/gate.h"
#include "adapters/ceres/src/incremental_solve.h"
#include "adapters/ceres/src/introspection.h"
#include "adapters/ceres/src/option_mapping.h"
#include "adapters/ceres/src/ordering.h"
#include "adapters/ceres/src/stock_ceres.h"

namespace inceres {

void Solve(const ceres::Solver::Options& options, ceres::Problem* problem, ceres::Solver::Summary* summary, SolveReport* report) {
  const internal::WallClock clock;
  CHECK(problem != nullptr);  // as ceres::Solve
  CHECK(summary != nullptr);
  *summary = ceres::Solver::Summary();
  const SolveMode mode = report != nullptr ? report->mode : SolveMode::kExact;
  internal::ClearResults(report);
  if (mode == SolveMode::kStock) {
    report->used_stock = true;
    report->fallback_reason = "SolveMode::kStock was asked for";
    internal::SolveWithStock(options, problem, summary);
    return;
  }
  const bool incremental = mode == SolveMode::kIncremental;
  ceres::EvaluationCallback* const callback = report != nullptr ? report->evaluation_callback : nullptr;
  std::string obstacle =
      incremental ? internal::IncrementalOptionsObstacle(options, callback) : internal::OptionsObstacle(options);
  internal::ProblemView view;
  internal::OrderingView ordering;
  if (obstacle.empty()) {
    view = internal::Introspect(*problem);
    ordering = internal::ReadOrdering(options, view);
    obstacle = incremental ? internal::IncrementalProblemObstacle(options, view, ordering)
                           : internal::ProblemObstacle(options, view, ordering);
  }
  if (!obstacle.empty()) {
    internal::Decline(options, problem, summary, obstacle, report);
    return;
  }
  const internal::SolveInput input{options, view, ordering, clock, callback};
  if (incremental) {
    const IncrementalOptions core = internal::MapIncrementalOptions(options, IncrementalOptions());
    internal::LivingProblem living(core, internal::Trust::kNothing);
    internal::SolveIncrementally(input, core, &living, summary, report);
  } else {
    internal::SolveExactly(input, summary, report);
  }
}

}  // namespace inceres
