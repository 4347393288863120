// The line search of a problem with bounds (docs/ceres_contract.md, "Line search for bounds"):
// members of TrustRegionMinimizer.
#include <algorithm>
#include <cmath>
#include <numeric>

#include "base/stopwatch.h"
#include "linearize/row_products.h"
#include "trust_region/armijo_search.h"
#include "trust_region/trust_region_minimizer.h"

namespace inceres::internal {

// The model's decrease is not computed again for a shortened step: Ceres leaves it, too.
void TrustRegionMinimizer::SearchAlongStep() {
  LineSearchSummary& search = summary_.line_search;
  const StageTimer timer(&search.total_seconds);
  const double residuals_before = summary_.seconds.residuals;
  const double jacobians_before = summary_.seconds.jacobians;
  const std::vector<double>& g = model_.Gradient();
  LineFunction function;
  function.value = cost_;
  function.slope = std::inner_product(g.begin(), g.end(), step_.begin(), 0.0);
  function.sample = [this](double t) { return SampleStep(t); };
  for (const double entry : step_) {
    function.step_max_norm = std::max(function.step_max_norm, std::fabs(entry));
  }
  if (const std::optional<double> t = SearchArmijo(options_, function, &search)) {
    std::transform(step_.begin(), step_.end(), step_.begin(),
                   [&](double entry) { return entry * *t; });
  }
  search.cost_seconds += summary_.seconds.residuals - residuals_before;
  search.gradient_seconds += summary_.seconds.jacobians - jacobians_before;
}

FunctionSample TrustRegionMinimizer::SampleStep(double t) {
  FunctionSample sample;
  sample.x = t;
  scaled_step_.resize(step_.size());
  std::transform(step_.begin(), step_.end(), scaled_step_.begin(),
                 [t](double entry) { return t * entry; });
  if (!evaluator_.points().MoveCandidate(scaled_step_.data())) {
    return sample;
  }
  if (options_.line_search_interpolation != LineSearchInterpolation::kCubic) {
    sample.value_is_valid = EvaluateCandidate(&sample.value) && std::isfinite(sample.value);
    return sample;
  }
  if (options_.observer != nullptr) {
    options_.observer->BeforeEvaluation(evaluator_.points().candidate().data(), /*jacobians=*/true,
                                        /*new_point=*/true);
  }
  ++summary_.work.num_jacobian_evaluations;
  if (trial_ == nullptr) {
    trial_ = std::make_unique<Evaluator>(graph_, evaluator_.layout(), evaluator_.executor());
  }
  trial_->points().SetCurrent(evaluator_.points().candidate());
  sample.value_is_valid = trial_->EvaluateJacobians(/*known_point=*/false, &sample.value).ok() &&
                          std::isfinite(sample.value);
  if (sample.value_is_valid) {
    // δᵀg = (Jδ)ᵀf, from the two sums that the pass over J yields.
    const RowProducts products = MultiplyJacobian(*trial_, step_.data());
    sample.slope = -products.model_decrease - 0.5 * products.squared_norm;
    sample.slope_is_valid = std::isfinite(sample.slope);
  }
  clock_.Charge(&summary_.seconds.jacobians);
  return sample;
}

}  // namespace inceres::internal
