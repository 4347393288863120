#include "trust_region/bounded_line_search.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>

#include "base/stopwatch.h"
#include "linearize/row_products.h"
#include "trust_region/armijo_search.h"

namespace inceres::internal {

// Line search along the projection of a step into the bounds (docs/ceres_contract.md, "Line search
// for bounds"): φ(t) = F(Plus(x, tδ)) with Plus clamped, slope gᵀδ at 0. The slope is that of the
// unclamped line, so a step that runs along a bound may gain less than the slope says, and is
// shortened.

// The model's decrease is not computed again for a shortened step: Ceres leaves it, too.
void BoundedLineSearch::Shorten(double cost, std::vector<double>* step) {
  LineSearchSummary& search = summary_.line_search;
  const StageTimer timer(&search.total_seconds);
  // Evaluations charge their own stages; what they took here is told apart afterwards.
  const double residuals_before = summary_.seconds.residuals;
  const double jacobians_before = summary_.seconds.jacobians;
  const std::vector<double>& g = model_.Gradient();
  LineFunction function;
  // Slope and largest entry are those of the unscaled step at t = 0.
  function.value = cost;
  function.slope = std::inner_product(g.begin(), g.end(), step->begin(), 0.0);
  function.sample = [this, step](double t) { return Sample(*step, t); };
  for (const double entry : *step) {
    function.step_max_norm = std::max(function.step_max_norm, std::fabs(entry));
  }
  // Without a t the step stays as it was, which Ceres tries, too.
  if (const std::optional<double> t = SearchArmijo(options_, function, &search)) {
    std::transform(step->begin(), step->end(), step->begin(),
                   [&](double entry) { return entry * *t; });
  }
  search.cost_seconds += summary_.seconds.residuals - residuals_before;
  search.gradient_seconds += summary_.seconds.jacobians - jacobians_before;
}

FunctionSample BoundedLineSearch::Sample(const std::vector<double>& step, double t) {
  FunctionSample sample;
  sample.x = t;
  scaled_step_.resize(step.size());
  std::transform(step.begin(), step.end(), scaled_step_.begin(),
                 [t](double entry) { return t * entry; });
  // A trial where Plus fails has no value and is found wanting.
  if (!evaluation_.evaluator().points().MoveCandidate(scaled_step_.data())) {
    return sample;
  }
  if (options_.line_search_interpolation == LineSearchInterpolation::kCubic) {
    SampleSlope(step, &sample);
  } else {
    sample.value_is_valid = evaluation_.CandidateCost(&sample.value) && std::isfinite(sample.value);
  }
  return sample;
}

// Value and slope at the candidate.
void BoundedLineSearch::SampleSlope(const std::vector<double>& step, FunctionSample* sample) {
  Evaluator& evaluator = evaluation_.evaluator();
  ++summary_.work.num_jacobian_evaluations;
  // An evaluator of its own, made at the first use: a gradient there needs Jacobians, and those of
  // the current point must stay for the step that follows.
  if (trial_ == nullptr) {
    const JacobianStorage storage = evaluator.storage() == JacobianStorage::kWholeRows
                                        ? JacobianStorage::kBySlot
                                        : evaluator.storage();
    trial_ = std::make_unique<Evaluator>(evaluator.graph(), evaluator.layout(),
                                         evaluator.executor(), storage);
  }
  trial_->points().SetCurrent(evaluator.points().candidate());
  Status status = trial_->points().ComputeTangents();
  // Told like any evaluation with Jacobians, for Ceres evaluates the gradient there.
  if (status.ok() && options_.observer != nullptr) {
    options_.observer->BeforeEvaluation(evaluator.points().candidate().data(), /*jacobians=*/true,
                                        /*new_point=*/true);
  }
  if (status.ok()) {
    status = trial_->EvaluateJacobians(/*known_point=*/false, &sample->value,
                                       /*knows_tangents=*/true);
  }
  sample->value_is_valid = status.ok() && std::isfinite(sample->value);
  if (sample->value_is_valid) {
    // δᵀg = (Jδ)ᵀf, from the two sums that the pass over J yields.
    const RowProducts products = MultiplyJacobian(*trial_, step.data());
    sample->slope = -products.model_decrease - 0.5 * products.squared_norm;
    sample->slope_is_valid = std::isfinite(sample->slope);
  }
  evaluation_.clock().Charge(&summary_.seconds.jacobians);
}

}  // namespace inceres::internal
