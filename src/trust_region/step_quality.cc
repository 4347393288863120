#include "trust_region/step_quality.h"

#include <algorithm>
#include <limits>

namespace inceres::internal {

// ϱ of docs/algorithms.md, "Step quality", with Ceres's numbers (docs/ceres_contract.md, "Step
// quality and non-monotonic steps"). The larger of two ratios: against the last cost, and against
// a reference some steps back whose decrease by the model is the sum of all since. Where the
// window is 0 the reference is always the last cost, and both are equal.

StepQuality::StepQuality(double initial_cost, int max_consecutive_nonmonotonic_steps)
    : window_(max_consecutive_nonmonotonic_steps),
      minimum_cost_(initial_cost),
      current_cost_(initial_cost),
      reference_cost_(initial_cost),
      candidate_cost_(initial_cost) {
}

// The denominators are promises, positive for a valid step.
double StepQuality::Evaluate(double cost, double model_decrease) const {
  // A step whose end has no cost is worse than any other.
  if (cost >= std::numeric_limits<double>::max()) {
    return std::numeric_limits<double>::lowest();
  }
  const double relative_decrease = (current_cost_ - cost) / model_decrease;
  const double historical_relative_decrease =
      (reference_cost_ - cost) / (decrease_since_reference_ + model_decrease);
  return std::max(relative_decrease, historical_relative_decrease);
}

void StepQuality::StepAccepted(double cost, double model_decrease) {
  // Both sums run from the same steps; they differ in where they began.
  current_cost_ = cost;
  decrease_since_candidate_ += model_decrease;
  decrease_since_reference_ += model_decrease;
  // A new minimum: the count of steps without one begins anew, and so does the search for the
  // highest cost since.
  if (cost < minimum_cost_) {
    minimum_cost_ = cost;
    num_nonmonotonic_steps_ = 0;
    candidate_cost_ = cost;
    decrease_since_candidate_ = 0.0;
  } else {
    ++num_nonmonotonic_steps_;
    // The highest cost since the minimum is the next reference.
    if (cost > candidate_cost_) {
      candidate_cost_ = cost;
      decrease_since_candidate_ = 0.0;
    }
  }
  // Exactly when the count gets there: later steps keep the reference until a new minimum.
  if (num_nonmonotonic_steps_ == window_) {
    reference_cost_ = candidate_cost_;
    decrease_since_reference_ = decrease_since_candidate_;
  }
}

}  // namespace inceres::internal
