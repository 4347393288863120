#include "trust_region/step_quality.h"

#include <algorithm>
#include <limits>

namespace inceres::internal {

StepQuality::StepQuality(double initial_cost, int max_consecutive_nonmonotonic_steps)
    : window_(max_consecutive_nonmonotonic_steps),
      minimum_cost_(initial_cost),
      current_cost_(initial_cost),
      reference_cost_(initial_cost),
      candidate_cost_(initial_cost) {
}

double StepQuality::Evaluate(double cost, double model_decrease) const {
  if (cost >= std::numeric_limits<double>::max()) {
    return std::numeric_limits<double>::lowest();
  }
  const double relative_decrease = (current_cost_ - cost) / model_decrease;
  const double historical_relative_decrease =
      (reference_cost_ - cost) / (decrease_since_reference_ + model_decrease);
  return std::max(relative_decrease, historical_relative_decrease);
}

void StepQuality::StepAccepted(double cost, double model_decrease) {
  current_cost_ = cost;
  decrease_since_candidate_ += model_decrease;
  decrease_since_reference_ += model_decrease;
  if (cost < minimum_cost_) {
    minimum_cost_ = cost;
    num_nonmonotonic_steps_ = 0;
    candidate_cost_ = cost;
    decrease_since_candidate_ = 0.0;
  } else {
    ++num_nonmonotonic_steps_;
    if (cost > candidate_cost_) {
      candidate_cost_ = cost;
      decrease_since_candidate_ = 0.0;
    }
  }
  if (num_nonmonotonic_steps_ == window_) {
    reference_cost_ = candidate_cost_;
    decrease_since_reference_ = decrease_since_candidate_;
  }
}

}  // namespace inceres::internal
