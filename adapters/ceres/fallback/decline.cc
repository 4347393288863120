#include "adapters/ceres/fallback/decline.h"

#include <glog/logging.h>

namespace inceres::internal {

void Decline(const SolveCall& call, const std::string& reason) {
  call.report->fallback_reason = reason;
  call.report->exact_reason.clear();  // it is not solved here, exactly or not
  if (call.solve_options.strict) {
    call.summary->termination_type = ceres::FAILURE;
    call.summary->message =
        "inceres does not solve this problem, and strict forbids stock Ceres: " + reason;
    return;
  }
  call.report->used_stock = true;
  LOG(INFO) << "inceres: handed to stock Ceres: " << reason;
  SolveWithStock(call.options, call.problem, call.summary);
}

}  // namespace inceres::internal
