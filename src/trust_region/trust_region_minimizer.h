#pragma once

#include <initializer_list>
#include <limits>
#include <memory>
#include <optional>
#include <vector>

#include "base/stopwatch.h"
#include "inceres/solver/options.h"
#include "inceres/solver/solver.h"
#include "inceres/solver/summary.h"
#include "linearize/evaluator.h"
#include "schur/inner_iterations.h"
#include "trust_region/agreement.h"
#include "trust_region/coordinate_descent.h"
#include "trust_region/linear_model.h"
#include "trust_region/loop_options.h"
#include "trust_region/polynomial.h"
#include "trust_region/step_quality.h"
#include "trust_region/strategy.h"

namespace inceres::internal {

/// What a minimizer works in. Handed on to the next one of the same sizes, which then asks for no
/// memory.
struct TrustRegionMemory {
  std::vector<double> scale;
  std::vector<double> best_state;
  std::vector<double> step;
  std::vector<double> scaled_step;
  std::vector<double> negative_gradient;
  std::unique_ptr<TrustRegionStrategy> strategy;
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

  const std::vector<double>& best_state() const { return best_state_; }

  /// Costs of iterations before this one are of another function: factors have moved their
  /// expansion points since.
  int first_comparable_iteration() const { return first_comparable_iteration_; }

 private:
  bool ProjectStart();
  bool EvaluateStart();
  bool Resume();
  void KeepPosition();
  bool FinalizeIterationAndContinue();
  void AskForRadius();
  bool ComputeStep();
  void ShowSystem();
  bool HandleInvalidStep();
  void SearchAlongStep();
  FunctionSample SampleStep(double t);
  void ComputeCandidate();
  bool IsByMarquardt() const { return options_.strategy == TrustRegionStrategyKind::kMarquardt; }
  bool HasCandidate() const { return candidate_cost_ < std::numeric_limits<double>::max(); }
  /// Whether the last step was short only because it, or its end, cannot be evaluated.
  bool IsHeldAtBorder() const { return IsByMarquardt() && (is_cut_ || !HasCandidate()); }
  bool CutStep(double* cost);
  void LeaveBorder();
  void ShortenStep(double* cost);
  bool EvaluateAlong(double t, double* cost);
  void TakeShare(double t);
  bool Recenter();
  StepQuality JudgeFromHere() const;
  void RunInnerIterations();
  void DescendByCoordinates();
  bool ParameterToleranceReached();
  bool FunctionToleranceReached();
  bool AcceptStep();
  bool FinishHere();
  void RejectStep();

  bool EvaluateCandidate(double* cost);
  bool IsCostUsable(double cost) const;
  bool EvaluateGradientAndJacobian(bool new_point);
  bool ComputeGradientNorms();
  bool MoveCandidate(const std::vector<double>& step);
  double StateNorm() const;
  double StateDistance(const std::vector<double>& a, const std::vector<double>& b,
                       double* max_norm) const;
  bool CallbacksContinue();
  ObserverAction AskObservers();
  bool Finish(Termination termination, std::initializer_list<const char*> words);

  const SolverOptions& options_;
  const LoopOptions& loop_;
  Evaluator& evaluator_;
  LinearModel& model_;
  Summary& summary_;
  const FactorGraph& graph_;
  const Agreement alone_;
  const Agreement& agreement_;
  StageClock clock_;
  const double start_time_;

  std::vector<double>& scale_;
  std::vector<double>& best_state_;
  std::vector<double>& step_;
  std::vector<double>& scaled_step_;
  std::vector<double>& negative_gradient_;
  std::unique_ptr<TrustRegionStrategy>& strategy_;
  std::optional<StepQuality> quality_;
  std::unique_ptr<InnerIterations> inner_iterations_;      // null: none
  std::unique_ptr<CoordinateDescent> coordinate_descent_;  // null: none, or no more
  bool descent_was_useful_ = false;
  IterationSummary iteration_;
  double iteration_start_time_ = 0.0;

  // evaluates slopes along a step: the Jacobians of the current point are still needed
  std::unique_ptr<Evaluator> trial_;
  double cost_ = 0.0;  // at the current point
  double candidate_cost_ = 0.0;
  bool is_cut_ = false;  // the step, before a border
  double best_cost_;
  double model_decrease_ = 0.0;
  double state_norm_ = -1.0;  // unknown until a step was accepted (CeresRules::k21)
  bool any_step_accepted_ = false;
  int num_consecutive_invalid_steps_ = 0;
  int first_comparable_iteration_ = 0;
};

}  // namespace inceres::internal
