#pragma once

#include <memory>
#include <vector>

#include "inceres/solver/options.h"
#include "inceres/solver/summary.h"
#include "linearize/evaluator.h"
#include "trust_region/linear_model.h"
#include "trust_region/loop_evaluation.h"
#include "trust_region/polynomial.h"

namespace inceres::internal {

/// The line search by which a step of a problem with bounds is shortened before it is tried, along
/// its projection (docs/ceres_contract.md, "Line search for bounds").
class BoundedLineSearch {
 public:
  /// `scaled_step`: memory to work in. All of them outlive this.
  BoundedLineSearch(const SolverOptions& options, LoopEvaluation* evaluation, LinearModel* model,
                    std::vector<double>* scaled_step, Summary* summary)
      : options_(options),
        evaluation_(*evaluation),
        model_(*model),
        scaled_step_(*scaled_step),
        summary_(*summary) {}

  /// Shortens the step from the current point, of this cost, if that is found worth it.
  void Shorten(double cost, std::vector<double>* step);

 private:
  FunctionSample Sample(const std::vector<double>& step, double t);
  void SampleSlope(const std::vector<double>& step, FunctionSample* sample);

  const SolverOptions& options_;
  LoopEvaluation& evaluation_;
  LinearModel& model_;
  std::vector<double>& scaled_step_;
  Summary& summary_;
  // evaluates slopes: the Jacobians of the current point are still needed
  std::unique_ptr<Evaluator> trial_;
};

}  // namespace inceres::internal
