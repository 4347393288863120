#include "robust/gnc_schedule.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "base/option_rules.h"

namespace inceres {
namespace internal {

// μ and the weights of graduated non-convexity (docs/algorithms.md, "Graduated non-convexity";
// Yang et al. 2020, equations 10 to 14), with s = ‖f‖²/c². Truncated least squares begins near μ =
// 0, which is convex, and grows; Geman–McClure begins large and falls to 1.

bool GncSchedule::Begin(double largest) {
  // μ from 1/(2 s_max − 1) and from 2 s_max: the cost is convex up to the largest suspect.
  const double convex =
      kernel_ == GncKernel::kGemanMcClure ? 2.0 * largest : 1.0 / (2.0 * largest - 1.0);
  // a residual of this square or more begins at the smallest number that still grows
  // Up to 1 all suspects are inliers of the last cost, and there is nothing to graduate.
  mu_ = largest <= 1.0 ? 0.0 : std::max(convex, 1e-100);
  return mu_ > 0.0;
}

// Geman–McClure's μ falls and stops at the last cost; that of truncation grows until the weights
// end it.
void GncSchedule::Advance() {
  mu_ = kernel_ == GncKernel::kGemanMcClure ? std::max(1.0, mu_ / step_) : mu_ * step_;
}

// Never backwards: smaller suspects than before are further on.
void GncSchedule::SkipTo(double largest) {
  GncSchedule anew(kernel_, step_);
  if (anew.Begin(largest)) {
    mu_ = kernel_ == GncKernel::kGemanMcClure ? std::max(1.0, std::min(mu_, anew.mu_))
                                              : std::max(mu_, anew.mu_);
  }
}

// Yang et al. 2020, equations 12 and 14.
// With s and μ positive: the quotient for Geman–McClure, and for truncation √(μ(μ + 1)/s) − μ
// between the two bends, where it falls from 1 to 0.
double GncSchedule::Weight(double s) const {
  if (kernel_ == GncKernel::kGemanMcClure) {
    const double root = mu_ / (s + mu_);
    return root * root;
  }
  // s ≤ μ/(μ + 1): weight 1.
  if (s <= mu_ / (mu_ + 1.0)) {
    return 1.0;
  }
  // s ≥ (μ + 1)/μ: weight 0. As a product, for μ may be as small as 1e-100.
  if (mu_ * s >= mu_ + 1.0) {
    return 0.0;
  }
  const double weight = std::sqrt(mu_ * (mu_ + 1.0) / s) - mu_;
  // Rounding at the bends.
  return std::min(1.0, std::max(0.0, weight));
}

// Of μ = 1 and of μ → ∞: what the graduation ends with.
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
  return internal::OptionRules("GncOptions")
      .Require(inlier_probability > 0.0 && inlier_probability < 1.0, "inlier_probability",
               inlier_probability, "between 0 and 1")
      .Require(threshold_scale > 0.0 && std::isfinite(threshold_scale), "threshold_scale",
               threshold_scale, "positive and finite")
      .Require(step > 1.0 && std::isfinite(step), "step", step, "greater than 1 and finite")
      .AtLeastOne("max_rounds", max_rounds)
      .AtLeastOne("iterations_a_round", iterations_a_round)
      .Also(solver.Validate())
      .status();
}

}  // namespace inceres
