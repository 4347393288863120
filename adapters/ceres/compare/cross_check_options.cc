#include "inceres/ceres/cross_check.h"

namespace inceres {

Status CrossCheckOptions::Validate() const {
  const auto complaint = [](const char* field, double value) {
    return Status::Error(StatusCode::kInvalidArgument,
                         "CrossCheckOptions::" + std::string(field) + " is " + std::to_string(value) + "; it must be at least 0");
  };
  if (cost_tolerance && !(*cost_tolerance >= 0.0)) {
    return complaint("cost_tolerance", *cost_tolerance);
  }
  if (parameter_tolerance && !(*parameter_tolerance >= 0.0)) {
    return complaint("parameter_tolerance", *parameter_tolerance);
  }
  if (iteration_tolerance && *iteration_tolerance < 0) {
    return complaint("iteration_tolerance", *iteration_tolerance);
  }
  if (radius_tolerance && !(*radius_tolerance >= 0.0)) {
    return complaint("radius_tolerance", *radius_tolerance);
  }
  if (!(spread_factor >= 0.0)) {
    return complaint("spread_factor", spread_factor);
  }
  if (spread_interval < 0) {
    return complaint("spread_interval", spread_interval);
  }
  return Status::Ok();
}

}  // namespace inceres
