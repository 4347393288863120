#pragma once

#include <limits>
#include <memory>
#include <numeric>
#include <vector>

#include "inceres/solver/options.h"
#include "inceres/solver/summary.h"
#include "schur/inner_iterations.h"
#include "trust_region/coordinate_descent.h"
#include "trust_region/linear_model.h"
#include "trust_region/loop_evaluation.h"
#include "trust_region/loop_options.h"

namespace inceres::internal {

/// A step on trial: what its model promises, where it leads, and what that costs.
///
/// By Marquardt's rule a step whose end cannot be evaluated is cut, and one that is too long for
/// its model is shortened: more damping would cost a linear solve for each of these lengths.
///
/// Its end may move on before the step is judged: landmarks one by one, with the frames held
/// (ours), or rounds of coordinate descent (Ceres's inner iterations). What either gains counts as
/// promised, as in Ceres: it says nothing about the step's model.
class StepTrial {
 public:
  StepTrial(const LoopParts& parts, LoopEvaluation* evaluation);

  /// The step; who writes it asks for its promise next.
  std::vector<double>& step() { return step_; }
  /// What the model promises for it.
  double FindPromise();
  double promise() const { return promise_; }

  /// Follows the step from the current point, which costs so much. The iteration learns of a share
  /// taken, and of what was promised.
  void Run(double cost, IterationSummary* iteration);

  /// At the end of the step; the largest number there is if it cannot be evaluated.
  double cost() const { return cost_; }
  bool HasEnd() const { return cost_ < std::numeric_limits<double>::max(); }
  /// Before a border: no length beyond can be evaluated.
  bool is_cut() const { return is_cut_; }
  /// No length of it can be evaluated.
  bool EndsBeyondBorder() const { return IsByMarquardt() && !HasEnd(); }
  /// Whether it is short only because it, or its end, cannot be evaluated, or variables were held.
  bool IsHeldAtBorder() const { return holds_ || is_cut_ || EndsBeyondBorder(); }

  /// From now on steps leave the variables where they are that have refused to be evaluated since a
  /// whole step was last taken, or they do not: which ones, by flags.
  const std::vector<char>& Hold(bool holds);
  /// The degrees of freedom of those variables.
  int num_refusing() const { return std::accumulate(refusing_.begin(), refusing_.end(), 0); }
  /// Those of the factor at which the last pass that failed did so are of these from now on: the
  /// end of the step, or the point that was accepted, cannot be evaluated.
  void NoteRefusal();
  /// Whether coordinate descent has led below where the step began: such a step is taken whatever
  /// its gain ratio.
  bool descent_was_useful() const { return descent_was_useful_; }
  /// Whether the cost is a sum from which gains were taken off.
  bool RefinesLandmarks() const { return inner_iterations_ != nullptr; }

 private:
  bool IsByMarquardt() const {
    return parts_.options.strategy == TrustRegionStrategyKind::kMarquardt;
  }
  void Follow(double start_cost, IterationSummary* iteration);
  void RefineLandmarks(double start_cost, IterationSummary* iteration);
  void Descend(double start_cost, IterationSummary* iteration);
  bool EvaluateAlong(double t, double* cost);
  void TakeShare(double t, IterationSummary* iteration);
  bool Cut(double start_cost, double* cost, IterationSummary* iteration);
  double GoUpToBorder(double t, double beyond, double* cost, double* last_tried);
  void Shorten(double start_cost, double* cost, IterationSummary* iteration);

  const LoopParts& parts_;
  LoopEvaluation& evaluation_;
  std::vector<double>& step_;
  std::vector<double>& scaled_step_;
  std::unique_ptr<InnerIterations> inner_iterations_;      // null: none
  std::unique_ptr<CoordinateDescent> coordinate_descent_;  // null: none, or no more
  double promise_ = 0.0;
  double cost_ = 0.0;
  bool is_cut_ = false;
  // per entry of a packed vector whether it is of a variable that has refused; empty: none is
  std::vector<char> refusing_;
  bool holds_ = false;
  const std::vector<char> no_flags_;
  bool descent_was_useful_ = false;
};

}  // namespace inceres::internal
