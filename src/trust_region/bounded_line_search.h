#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "inceres/solver/options.h"
#include "inceres/solver/summary.h"
#include "linearize/evaluator.h"
#include "trust_region/linear_model.h"
#include "trust_region/loop_evaluation.h"
#include "trust_region/polynomial.h"

namespace inceres::internal {

/// A function of the step size, known at 0: φ(0) and φ'(0) < 0 of a step whose largest entry is
/// step_max_norm.
struct LineFunction {
  double value = 0.0;
  double slope = 0.0;
  double step_max_norm = 0.0;
  /// φ(t), valid only if finite; with φ'(t) for kCubic
  std::function<FunctionSample(double t)> sample;
};

/// The first t, from 1 downward, with φ(t) ≤ φ(0) + c₁ φ'(0) t; none if the options' limits come
/// first. A t that cannot be evaluated is found wanting. Counts steps and polynomial seconds in
/// `summary`. Source: Nocedal & Wright, section 3.1 and 3.5; order of tests and choice of the next
/// t of Ceres 2.1's ArmijoLineSearch.
std::optional<double> SearchArmijo(const SolverOptions& options, const LineFunction& function,
                                   LineSearchSummary* summary);

/// The line search by which a step of a problem with bounds is shortened before it is tried, along
/// its projection (docs/ceres_contract.md, "Line search for bounds").
class BoundedLineSearch {
 public:
  BoundedLineSearch(const LoopParts& parts, LoopEvaluation* evaluation)
      : parts_(parts), evaluation_(*evaluation) {}

  /// Shortens the step from the current point, of this cost, if that is found worth it.
  void Shorten(double cost, std::vector<double>* step);

 private:
  FunctionSample Sample(const std::vector<double>& step, double t);
  void SampleSlope(const std::vector<double>& step, FunctionSample* sample);

  const LoopParts& parts_;
  LoopEvaluation& evaluation_;
  // evaluates slopes: the Jacobians of the current point are still needed
  std::unique_ptr<Evaluator> trial_;
};

}  // namespace inceres::internal
