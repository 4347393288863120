#include "adapters/ceres/fallback/decline.h"

#include <utility>

#include <glog/logging.h>

#include "adapters/ceres/fallback/stock_ceres.h"

namespace inceres::internal {

void ClearResults(SolveReport* report) {
  if (report != nullptr) {
    SolveReport cleared;
    cleared.mode = report->mode;
    cleared.strict = report->strict;
    cleared.evaluation_callback = report->evaluation_callback;
    cleared.problem_unedited = report->problem_unedited;
    cleared.cross_check = report->cross_check;
    cleared.ab_log = std::move(report->ab_log);
    *report = std::move(cleared);
  }
}

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
  SolveWithStock(options, problem, summary);
}

}  // namespace inceres::internal
