#include "trust_region/armijo_search.h"

#include <algorithm>

#include "base/stopwatch.h"

namespace inceres::internal {
namespace {

// Armijo's search, φ(t) ≤ φ(0) + c₁ φ'(0) t from t = 1 downward (docs/ceres_contract.md, "Line
// search for bounds"; Nocedal & Wright, sections 3.1 and 3.5). The order of tests, and what is
// counted when, are those of Ceres 2.1: with the same numbers the same t are tried.

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

}  // namespace inceres::internal
