#include "trust_region/bounded_line_search.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "base/stopwatch.h"
#include "linearize/row_products.h"

namespace inceres::internal {

// Line search along the projection of a step into the bounds (docs/ceres_contract.md, "Line search
// for bounds"): φ(t) = F(Plus(x, tδ)) with Plus clamped, slope gᵀδ at 0. The slope is that of the
// unclamped line, so a step that runs along a bound may gain less than the slope says, and is
// shortened.
//
// The search is Armijo's, φ(t) ≤ φ(0) + c₁ φ'(0) t from t = 1 downward (Nocedal & Wright, sections
// 3.1 and 3.5). The order of tests, and what is counted when, are those of Ceres 2.1: with the same
// numbers the same t are tried.

namespace {

// A quadratic is fitted to values, and the slope at 0; a cubic to everything.
FunctionSample Reduce(FunctionSample sample, LineSearchInterpolation interpolation) {
  sample.slope_is_valid = sample.slope_is_valid && interpolation == LineSearchInterpolation::kCubic;
  return sample;
}

double NextStepSize(const SolverOptions& options, const FunctionSample& start,
                    const FunctionSample& previous, const FunctionSample& current) {
  // Contraction is a factor: the "largest contraction" is the smallest step.
  const double smallest = options.max_line_search_step_contraction * current.x;
  const double largest = options.min_line_search_step_contraction * current.x;
  // Half, within the limits, where no polynomial can be fitted.
  if (!current.value_is_valid ||
      options.line_search_interpolation == LineSearchInterpolation::kBisection) {
    return std::min(std::max(0.5 * current.x, smallest), largest);
  }
  // The start has value and slope, so that there is a parabola from the first trial on; the trial
  // before the last adds to its degree.
  std::vector<FunctionSample> samples = {start, Reduce(current, options.line_search_interpolation)};
  if (previous.value_is_valid) {
    samples.push_back(Reduce(previous, options.line_search_interpolation));
  }
  return MinimizeInterpolant(samples, smallest, largest);
}

}  // namespace

std::optional<double> SearchArmijo(const SolverOptions& options, const LineFunction& function,
                                   LineSearchSummary* summary) {
  const FunctionSample start = {0.0, function.value, function.slope, true, true};
  FunctionSample previous;
  // The full step is a trial like the others.
  FunctionSample current = function.sample(1.0);
  const double wanted_slope = options.line_search_sufficient_function_decrease * function.slope;
  int num_steps = 0;
  // A value that is not finite has no valid flag: the comparison never sees NaN.
  while (!current.value_is_valid || current.value > function.value + wanted_slope * current.x) {
    ++summary->num_steps;
    if (++num_steps >= options.max_num_line_search_step_size_iterations) {
      return std::nullopt;
    }
    double t = 0.0;
    {
      const StageTimer timer(&summary->polynomial_seconds);
      t = NextStepSize(options, start, previous, current);
    }
    // The step in the variable that it moves most.
    if (t * function.step_max_norm < options.min_line_search_step_size) {
      return std::nullopt;
    }
    previous = current;
    current = function.sample(t);
  }
  return current.x;
}

// The model's decrease is not computed again for a shortened step: Ceres leaves it, too.
void BoundedLineSearch::Shorten(double cost, std::vector<double>* step) {
  LineSearchSummary& search = parts_.summary.line_search;
  const StageTimer timer(&search.total_seconds);
  // Evaluations charge their own stages; what they took here is told apart afterwards.
  const double residuals_before = parts_.summary.seconds.residuals;
  const double jacobians_before = parts_.summary.seconds.jacobians;
  const std::vector<double>& g = parts_.model.Gradient();
  LineFunction function;
  // Slope and largest entry are those of the unscaled step at t = 0.
  function.value = cost;
  function.slope = std::inner_product(g.begin(), g.end(), step->begin(), 0.0);
  function.sample = [this, step](double t) { return Sample(*step, t); };
  for (const double entry : *step) {
    function.step_max_norm = std::max(function.step_max_norm, std::fabs(entry));
  }
  // Without a t the step stays as it was, which Ceres tries, too.
  if (const std::optional<double> t = SearchArmijo(parts_.options, function, &search)) {
    std::transform(step->begin(), step->end(), step->begin(),
                   [&](double entry) { return entry * *t; });
  }
  search.cost_seconds += parts_.summary.seconds.residuals - residuals_before;
  search.gradient_seconds += parts_.summary.seconds.jacobians - jacobians_before;
}

FunctionSample BoundedLineSearch::Sample(const std::vector<double>& step, double t) {
  FunctionSample sample;
  sample.x = t;
  std::vector<double>& scaled_step = parts_.memory.scaled_step;
  scaled_step.resize(step.size());
  std::transform(step.begin(), step.end(), scaled_step.begin(),
                 [t](double entry) { return t * entry; });
  // A trial where Plus fails has no value and is found wanting.
  if (!parts_.evaluator.points().MoveCandidate(scaled_step.data())) {
    return sample;
  }
  if (parts_.options.line_search_interpolation == LineSearchInterpolation::kCubic) {
    SampleSlope(step, &sample);
  } else {
    sample.value_is_valid = evaluation_.CandidateCost(&sample.value) && std::isfinite(sample.value);
  }
  return sample;
}

// Value and slope at the candidate.
void BoundedLineSearch::SampleSlope(const std::vector<double>& step, FunctionSample* sample) {
  Evaluator& evaluator = parts_.evaluator;
  ++parts_.summary.work.num_jacobian_evaluations;
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
  if (status.ok() && parts_.options.observer != nullptr) {
    parts_.options.observer->BeforeEvaluation(evaluator.points().candidate().data(),
                                              /*jacobians=*/true,
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
  parts_.clock.Charge(&parts_.summary.seconds.jacobians);
}

}  // namespace inceres::internal
