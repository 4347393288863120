#include "inceres/ceres/solve.h"

#include <string>

#include <glog/logging.h>

#include "adapters/ceres/src/exact_solve.h"
#include "adapters/ceres/src/gate.h"
#include "adapters/ceres/src/introspection.h"
#include "adapters/ceres/src/ordering.h"
#include "adapters/ceres/src/stock_ceres.h"

namespace inceres {
namespace {

// What the caller asks for stays, what happened is cleared.
SolveReport Cleared(const SolveReport& report) {
  SolveReport cleared;
  cleared.mode = report.mode;
  cleared.strict = report.strict;
  return cleared;
}

// A problem we do not solve: stock Ceres does, unless the caller is strict. Nothing of the user's has been called or written so
// far.
void Decline(const ceres::Solver::Options& options, ceres::Problem* problem, ceres::Solver::Summary* summary,
             const std::string& reason, SolveReport* report) {
  if (report != nullptr) {
    report->fallback_reason = reason;
    if (report->strict) {
      summary->termination_type = ceres::FAILURE;
      summary->message = "inceres does not solve this problem, and strict forbids stock Ceres: " + reason;
      return;
    }
    report->used_stock = true;
  }
  LOG(INFO) << "inceres: handed to stock Ceres: " << reason;
  internal::SolveWithStock(options, problem, summary);
}

}  // namespace

void Solve(const ceres::Solver::Options& options, ceres::Problem* problem, ceres::Solver::Summary* summary, SolveReport* report) {
  const internal::WallClock clock;
  CHECK(problem != nullptr);  // as ceres::Solve
  CHECK(summary != nullptr);
  *summary = ceres::Solver::Summary();
  const SolveMode mode = report != nullptr ? report->mode : SolveMode::kExact;
  if (report != nullptr) {
    *report = Cleared(*report);
  }
  if (mode == SolveMode::kStock) {
    report->used_stock = true;
    report->fallback_reason = "SolveMode::kStock was asked for";
    internal::SolveWithStock(options, problem, summary);
    return;
  }
  std::string obstacle =
      mode == SolveMode::kIncremental ? "SolveMode::kIncremental is not available yet" : internal::OptionsObstacle(options);
  internal::ProblemView view;
  internal::OrderingView ordering;
  if (obstacle.empty()) {
    view = internal::Introspect(*problem);
    ordering = internal::ReadOrdering(options, view);
    obstacle = internal::ProblemObstacle(options, view, ordering);
  }
  if (!obstacle.empty()) {
    Decline(options, problem, summary, obstacle, report);
    return;
  }
  internal::SolveExactly({options, view, ordering, clock}, summary, report);
}

}  // namespace inceres
