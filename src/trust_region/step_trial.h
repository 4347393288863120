#pragma once

#include <limits>
#include <vector>

#include "inceres/solver/options.h"
#include "inceres/solver/summary.h"
#include "trust_region/candidate_refinement.h"
#include "trust_region/linear_model.h"
#include "trust_region/loop_evaluation.h"
#include "trust_region/loop_options.h"
#include "trust_region/refusing_variables.h"

namespace inceres::internal {

/// A step on trial: what its model promises, where it leads, and what that costs.
///
/// By Marquardt's rule a step whose end cannot be evaluated is cut, and one that is too long for
/// its model is shortened: more damping would cost a linear solve for each of these lengths.
/// Landmarks, or coordinate descent, may move the end on.
class StepTrial {
 public:
  /// `step`, `scaled_step`: memory to work in. All of them outlive this.
  StepTrial(const SolverOptions& options, const LoopOptions& loop, LoopEvaluation* evaluation,
            LinearModel* model, std::vector<double>* step, std::vector<double>* scaled_step,
            Summary* summary);

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
  int num_refusing() const { return refusing_.size(); }
  /// The point that was accepted cannot be evaluated after all.
  void NoteRefusal() { refusing_.Add(evaluation_.evaluator()); }
  /// Whether coordinate descent has led below where the step began: such a step is taken whatever
  /// its gain ratio.
  bool descent_was_useful() const { return descent_was_useful_; }
  /// Whether the cost is a sum from which gains were taken off.
  bool RefinesLandmarks() const { return refinement_.RefinesLandmarks(); }

 private:
  bool IsByMarquardt() const { return options_.strategy == TrustRegionStrategyKind::kMarquardt; }
  void Follow(double start_cost, IterationSummary* iteration);
  void Descend(double start_cost, IterationSummary* iteration);
  bool EvaluateAlong(double t, double* cost);
  void TakeShare(double t, IterationSummary* iteration);
  bool Cut(double start_cost, double* cost, IterationSummary* iteration);
  double GoUpToBorder(double t, double beyond, double* cost, double* last_tried);
  void Shorten(double start_cost, double* cost, IterationSummary* iteration);

  const SolverOptions& options_;
  LoopEvaluation& evaluation_;
  LinearModel& model_;
  std::vector<double>& step_;
  std::vector<double>& scaled_step_;
  Summary& summary_;
  CandidateRefinement refinement_;
  double promise_ = 0.0;
  double cost_ = 0.0;
  bool is_cut_ = false;
  RefusingVariables refusing_;
  bool holds_ = false;
  const std::vector<char> no_flags_;
  bool descent_was_useful_ = false;
};

}  // namespace inceres::internal
