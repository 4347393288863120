#pragma once

#include <initializer_list>
#include <memory>
#include <optional>
#include <vector>

#include "base/stopwatch.h"
#include "inceres/solver/options.h"
#include "inceres/solver/solver.h"
#include "inceres/solver/summary.h"
#include "linearize/evaluator.h"
#include "trust_region/bounded_line_search.h"
#include "trust_region/linear_model.h"
#include "trust_region/loop_evaluation.h"
#include "trust_region/loop_options.h"
#include "trust_region/step_quality.h"
#include "trust_region/step_solve.h"
#include "trust_region/step_trial.h"
#include "trust_region/strategy.h"

namespace inceres::internal {

/// The cheapest state that a solve has accepted. Where that is the current point, as mostly, there
/// is no copy of it.
class BestState {
 public:
  /// At first the current point. Of the memory for a copy nothing is touched yet.
  BestState(const PointPair& points, std::vector<double>* memory)
      : points_(points), copy_(*memory) {
    copy_.reserve(points.current().size());
  }

  /// Until the current point moves.
  const std::vector<double>& get() const { return is_current_ ? points_.current() : copy_; }

  /// The current point is a new one, while the candidate still is the one before.
  void Follow(bool current_is_best) {
    if (is_current_ && !current_is_best) {
      copy_ = points_.candidate();
    }
    is_current_ = current_is_best;
  }

 private:
  const PointPair& points_;
  std::vector<double>& copy_;
  bool is_current_ = true;
};

/// The trust-region loop in exact mode: Ceres's order of evaluations, tests, callbacks and messages
/// (docs/ceres_contract.md, "Trust-region loop").
///
///     evaluate the start
///     while not finished:
///       step -> candidate -> cost -> tolerances -> accept (evaluate Jacobians) or reject
///
/// With bounds the start is projected first, and each step is shortened by a line search before it
/// is tried.
///
/// Tolerances end the loop before the candidate is accepted, and the state returned is the cheapest
/// accepted one.
class TrustRegionMinimizer {
 public:
  TrustRegionMinimizer(const SolverOptions& options, const LoopOptions& loop, Evaluator* evaluator,
                       LinearModel* model, TrustRegionMemory* memory, Summary* summary);

  /// Runs to termination. On a usable solution best_state() is the result.
  void Minimize();

  const std::vector<double>& best_state() const { return best_state_.get(); }

  /// Costs of iterations before this one are of another function: factors have moved their
  /// expansion points since.
  int first_comparable_iteration() const { return first_comparable_iteration_; }

 private:
  bool ProjectStart();
  bool EvaluateStart();
  bool Resume();
  void KeepPosition();
  void BeginIteration();
  bool FinalizeIterationAndContinue();
  bool CallbacksContinue();
  bool IsWorthTrying();
  bool TolerancesReached();
  bool AcceptStep();
  bool FinishHere();
  bool TakeBack();
  void RejectStep(double cost);
  void LeaveBorder();
  void AdaptRadius();
  bool Recenter();
  StepQuality JudgeFromHere() const;
  bool Linearize(bool new_point);
  bool UpdateModel();
  bool FailToLinearize();
  bool Finish(Termination termination, std::initializer_list<const char*> words);

  const SolverOptions& options_;
  const LoopOptions& loop_;
  Evaluator& evaluator_;
  LinearModel& model_;
  Summary& summary_;
  StageClock clock_;
  const double start_time_;
  const LoopParts parts_;
  LoopEvaluation evaluation_;
  StepTrial trial_;
  StepSolve step_solve_;
  BoundedLineSearch line_search_;

  BestState best_state_;
  std::unique_ptr<TrustRegionStrategy>& strategy_;
  std::optional<StepQuality> quality_;
  IterationSummary iteration_;
  double iteration_start_time_ = 0.0;

  double cost_ = 0.0;  // at the current point
  double best_cost_;
  double state_norm_ = -1.0;  // unknown until a step was accepted (CeresRules::k21)
  bool any_step_accepted_ = false;
  int first_comparable_iteration_ = 0;
};

}  // namespace inceres::internal
