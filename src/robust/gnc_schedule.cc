#include "robust/gnc_schedule.h"

#include <algorithm>
#include <cmath>
#include <string>

namespace inceres {
namespace internal {

bool GncSchedule::Begin(double largest) {
  const double convex =
      kernel_ == GncKernel::kGemanMcClure ? 2.0 * largest : 1.0 / (2.0 * largest - 1.0);
  // a residual of this square or more begins at the smallest number that still grows
  mu_ = largest <= 1.0 ? 0.0 : std::max(convex, 1e-100);
  return mu_ > 0.0;
}

void GncSchedule::Advance() {
  mu_ = kernel_ == GncKernel::kGemanMcClure ? std::max(1.0, mu_ / step_) : mu_ * step_;
}

void GncSchedule::SkipTo(double largest) {
  GncSchedule anew(kernel_, step_);
  if (anew.Begin(largest)) {
    mu_ = kernel_ == GncKernel::kGemanMcClure ? std::max(1.0, std::min(mu_, anew.mu_))
                                              : std::max(mu_, anew.mu_);
  }
}

// Yang et al. 2020, equations 12 and 14; both roots written so that nothing cancels.
double GncSchedule::Weight(double s) const {
  if (kernel_ == GncKernel::kGemanMcClure) {
    const double root = mu_ / (s + mu_);
    return root * root;
  }
  if (s <= mu_ / (mu_ + 1.0)) {
    return 1.0;
  }
  if (mu_ * s >= mu_ + 1.0) {
    return 0.0;
  }
  const double weight = std::sqrt(mu_ * (mu_ + 1.0) / s) - mu_;
  return std::min(1.0, std::max(0.0, weight));
}

double GncSchedule::LastWeight(double s) const {
  if (kernel_ == GncKernel::kGemanMcClure) {
    return 1.0 / ((1.0 + s) * (1.0 + s));
  }
  return s <= 1.0 ? 1.0 : 0.0;
}

}  // namespace internal

const char* ToString(GncKernel kernel) {
  return kernel == GncKernel::kGemanMcClure ? "geman_mcclure" : "truncated_least_squares";
}

Status GncOptions::Validate() const {
  const auto refuse = [](const char* what) {
    return Status::Error(StatusCode::kInvalidArgument, std::string("GncOptions: ") + what);
  };
  if (!(inlier_probability > 0.0 && inlier_probability < 1.0)) {
    return refuse("inlier_probability must be between 0 and 1");
  }
  if (!(threshold_scale > 0.0) || !std::isfinite(threshold_scale)) {
    return refuse("threshold_scale must be positive and finite");
  }
  if (!(step > 1.0) || !std::isfinite(step)) {
    return refuse("step must be greater than 1 and finite");
  }
  if (max_rounds < 1) {
    return refuse("max_rounds must be at least 1");
  }
  if (iterations_a_round < 1) {
    return refuse("iterations_a_round must be at least 1");
  }
  return solver.Validate();
}

}  // namespace inceres
