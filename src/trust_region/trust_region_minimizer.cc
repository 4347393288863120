#include "trust_region/trust_region_minimizer.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "base/scientific.h"
#include "trust_region/observer_verdict.h"

namespace inceres::internal {
namespace {

// A landmark moves by itself if it gains more than this share of what the function tolerance allows
// all of them together.
constexpr double kInnerShare = 0.01;

// A step that gains less than this share of the cost leaves most residuals about as they were: the
// curvature of their losses counts.
constexpr double kSteadyGain = 0.01;

// A step of which less than this is taken was too long for its model.
constexpr double kLargeShare = 0.25;

constexpr std::size_t kExpectedIterations = 16;

}  // namespace

TrustRegionMinimizer::TrustRegionMinimizer(const SolverOptions& options, const LoopOptions& loop,
                                           Evaluator* evaluator, LinearModel* model,
                                           TrustRegionMemory* memory, Summary* summary)
    : options_(options),
      loop_(loop),
      evaluator_(*evaluator),
      model_(*model),
      summary_(*summary),
      graph_(evaluator->graph()),
      agreement_(loop.agreement != nullptr ? *loop.agreement : alone_),
      start_time_(clock_.now()),
      scale_(memory->scale),
      best_state_(memory->best_state),
      step_(memory->step),
      scaled_step_(memory->scaled_step),
      negative_gradient_(memory->negative_gradient),
      strategy_(memory->strategy),
      best_cost_(std::numeric_limits<double>::max()) {
  model->TimeInto(&summary->seconds, &clock_);
  best_state_ = evaluator->points().current();
  step_.assign(static_cast<std::size_t>(evaluator->layout().size()), 0.0);
  negative_gradient_.resize(step_.size());
  if (options.refine_landmarks && evaluator->layout().num_landmarks() > 0) {
    inner_iterations_ = std::make_unique<InnerIterations>(evaluator);
    summary->work.bytes += inner_iterations_->Bytes();
  }
  if (loop.inner_descent != nullptr) {
    coordinate_descent_ =
        std::make_unique<CoordinateDescent>(loop.inner_descent->groups, loop.rules, evaluator);
  }
}

void TrustRegionMinimizer::Minimize() {
  iteration_start_time_ = start_time_;
  summary_.num_successful_steps = 0;
  summary_.num_unsuccessful_steps = 0;
  summary_.is_constrained = evaluator_.points().IsConstrained();
  summary_.iterations.reserve(kExpectedIterations);
  if ((summary_.is_constrained && !ProjectStart()) || !EvaluateStart()) {
    return;
  }
  while (FinalizeIterationAndContinue()) {
    iteration_start_time_ = clock_.now();
    const IterationSummary previous = iteration_;
    iteration_ = IterationSummary();
    iteration_.iteration = previous.iteration + 1;
    iteration_.gradient_norm = previous.gradient_norm;
    iteration_.gradient_max_norm = previous.gradient_max_norm;
    if (loop_.judge != nullptr) {
      AskForRadius();
    }
    // of this step; at its end that of the next
    iteration_.trust_region_radius = strategy_->Radius();
    if (!ComputeStep()) {
      return;
    }
    if (!iteration_.step_is_valid) {
      if (!HandleInvalidStep()) {
        return;
      }
      continue;
    }
    if (loop_.judge != nullptr && !loop_.judge->IsWorthTrying(iteration_, cost_)) {
      GoesOn(ObserverAction::kTerminateSuccessfully, &summary_.termination, &summary_.message);
      return;
    }
    if (summary_.is_constrained && options_.max_num_line_search_step_size_iterations > 0) {
      SearchAlongStep();
    }
    ComputeCandidate();
    DescendByCoordinates();
    if (ParameterToleranceReached() || FunctionToleranceReached()) {
      return;
    }
    iteration_.relative_decrease = quality_->Evaluate(candidate_cost_, model_decrease_);
    if (descent_was_useful_ || iteration_.relative_decrease > options_.min_relative_decrease) {
      if (!AcceptStep()) {
        return;
      }
    } else {
      RejectStep();
    }
  }
}

void TrustRegionMinimizer::AskForRadius() {
  if (const double radius = loop_.judge->RestartRadius(); radius > 0.0) {
    strategy_->Restart(radius);
  }
  strategy_->Widen(loop_.judge->LeastRadius());
}

bool TrustRegionMinimizer::ProjectStart() {
  std::fill(step_.begin(), step_.end(), 0.0);
  if (!evaluator_.points().MoveCandidate(step_.data())) {
    return Finish(Termination::kFailure,
                  {"Unable to project initial point onto the feasible set."});
  }
  evaluator_.AcceptCandidate();
  state_norm_ = StateNorm();
  return true;
}

bool TrustRegionMinimizer::EvaluateStart() {
  iteration_ = IterationSummary();
  evaluator_.set_loss_curvature(LossCurvature::kPositive);
  Recenter();
  if (!EvaluateGradientAndJacobian(/*new_point=*/true)) {
    if (loop_.rules == CeresRules::k22) {
      Finish(Termination::kFailure, {"Initial residual and Jacobian evaluation failed."});
    }
    return false;
  }
  JacobiScale(model_.Diagonal(), options_.jacobi_scaling, &scale_);
  if (loop_.resume != nullptr) {
    scale_ = loop_.resume->scale;
  }
  model_.ScaleColumnsBy(scale_);
  StartStrategy(options_, scale_, &strategy_);
  quality_ = JudgeFromHere();
  summary_.initial_cost = cost_;
  iteration_.cost = summary_.initial_cost;
  iteration_.step_is_valid = true;
  iteration_.step_is_successful = true;
  return loop_.resume == nullptr || Resume();
}

// The iteration that ends now is the one after which the position was kept, once more.
bool TrustRegionMinimizer::Resume() {
  const LoopPosition& position = *loop_.resume;
  if (!strategy_->Restore(position.strategy)) {
    return Finish(Termination::kFailure, {"The position to resume is of another strategy."});
  }
  iteration_.iteration = position.iteration;
  iteration_.cost = cost_;
  summary_.initial_cost = position.initial_cost;
  summary_.num_successful_steps = position.num_successful_steps - 1;
  summary_.num_unsuccessful_steps = position.num_unsuccessful_steps;
  num_consecutive_invalid_steps_ = position.num_consecutive_invalid_steps;
  any_step_accepted_ = position.any_step_accepted;
  state_norm_ = any_step_accepted_ ? StateNorm() : state_norm_;
  return true;
}

void TrustRegionMinimizer::KeepPosition() {
  const bool again = loop_.resume != nullptr && loop_.resume->iteration == iteration_.iteration;
  if (loop_.keeper == nullptr || again || !loop_.keeper->Wants(iteration_.iteration)) {
    return;
  }
  LoopPosition position;
  position.iteration = iteration_.iteration;
  position.initial_cost = summary_.initial_cost;
  position.any_step_accepted = any_step_accepted_;
  position.num_consecutive_invalid_steps = num_consecutive_invalid_steps_;
  position.num_successful_steps = summary_.num_successful_steps;
  position.num_unsuccessful_steps = summary_.num_unsuccessful_steps;
  position.strategy = strategy_->Save();
  position.scale = scale_;
  loop_.keeper->Keep(position, evaluator_.points().current());
}

bool TrustRegionMinimizer::FinalizeIterationAndContinue() {
  if (iteration_.step_is_successful) {
    ++summary_.num_successful_steps;
    iteration_.step_is_nonmonotonic = !(cost_ < best_cost_);
    if (!iteration_.step_is_nonmonotonic) {
      best_cost_ = cost_;
      best_state_ = evaluator_.points().current();
    }
  } else {
    ++summary_.num_unsuccessful_steps;
  }
  iteration_.trust_region_radius = strategy_->Radius();
  const double now = clock_.Read();
  iteration_.iteration_time_in_seconds = now - iteration_start_time_;
  iteration_.cumulative_time_in_seconds = now - start_time_ + loop_.seconds_spent_before;
  summary_.iterations.push_back(iteration_);
  KeepPosition();

  if (!CallbacksContinue()) {
    return false;
  }
  const double elapsed = agreement_.Max(clock_.now() - start_time_ + loop_.seconds_spent_before);
  if (elapsed >= options_.max_solver_time_in_seconds) {
    return Finish(Termination::kNoConvergence,
                  {"Maximum solver time reached. Total solver time: ", Scientific(elapsed).text(),
                   " >= ", Scientific(options_.max_solver_time_in_seconds).text(), "."});
  }
  if (iteration_.iteration >= options_.max_num_iterations) {
    return Finish(Termination::kNoConvergence,
                  {"Maximum number of iterations reached. Number of iterations: ",
                   std::to_string(iteration_.iteration).c_str(), "."});
  }
  if (iteration_.step_is_successful &&
      iteration_.gradient_max_norm <= options_.gradient_tolerance) {
    return Finish(Termination::kConvergence,
                  {"Gradient tolerance reached. Gradient max norm: ",
                   Scientific(iteration_.gradient_max_norm).text(),
                   " <= ", Scientific(options_.gradient_tolerance).text()});
  }
  if (iteration_.trust_region_radius <= options_.min_trust_region_radius) {
    return Finish(Termination::kConvergence,
                  {"Minimum trust region radius reached. Trust region radius: ",
                   Scientific(iteration_.trust_region_radius).text(),
                   " <= ", Scientific(options_.min_trust_region_radius).text()});
  }
  return true;
}

bool TrustRegionMinimizer::CallbacksContinue() {
  if (agreement_.All(options_.observer == nullptr && !options_.progress && !options_.callback)) {
    return true;
  }
  const ObserverAction action = agreement_.Ask([this] { return AskObservers(); });
  clock_.Read();
  return GoesOn(action, &summary_.termination, &summary_.message);
}

ObserverAction TrustRegionMinimizer::AskObservers() {
  if (options_.progress) {
    if (iteration_.iteration == 0) {
      options_.progress(ProgressHeading());
    }
    options_.progress(ProgressRow(iteration_));
  }
  ObserverAction action = ObserverAction::kContinue;
  if (options_.observer != nullptr) {
    action = options_.observer->EndOfIteration(iteration_, best_state_.data());
  }
  return action == ObserverAction::kContinue && options_.callback
             ? options_.callback(iteration_, best_state_.data())
             : action;
}

// False only on an unrecoverable failure; otherwise iteration_.step_is_valid tells.
bool TrustRegionMinimizer::ComputeStep() {
  const double start = clock_.now();
  int num_solves = 0;
  const Status solved = strategy_->ComputeStep(&model_, step_.data(), &num_solves);
  iteration_.step_solver_time_in_seconds = clock_.Read() - start;
  iteration_.linear_solver_iterations =
      num_solves > 0 && summary_.work.reduced_size > 0 ? model_.num_iterations() : 0;
  summary_.work.num_linear_solves += num_solves;
  summary_.work.num_conjugate_gradients +=
      model_.is_iterative() ? iteration_.linear_solver_iterations : 0;
  summary_.work.num_steps_without_landmarks += model_.left_out_landmarks() ? 1 : 0;
  if (num_solves > 0) {
    ShowSystem();
  }
  if (!solved.ok() && solved.code != StatusCode::kSingular) {
    summary_.detail = solved.message;
    return Finish(Termination::kFailure, {"Linear solver failed due to unrecoverable non-numeric "
                                          "causes. Please see the error log for clues. "});
  }
  if (!solved.ok() || !model_.IsFinite(step_)) {
    summary_.detail = solved.ok() ? "the step is not finite" : solved.message;
    return true;
  }
  model_decrease_ = model_.ModelDecrease(step_.data());
  clock_.Charge(&summary_.seconds.model_cost);
  iteration_.step_is_valid = model_decrease_ > 0.0;
  if (iteration_.step_is_valid) {
    iteration_.model_cost_change = model_decrease_;
    num_consecutive_invalid_steps_ = 0;
  }
  return true;
}

bool TrustRegionMinimizer::HandleInvalidStep() {
  if (++num_consecutive_invalid_steps_ >= options_.max_num_consecutive_invalid_steps) {
    return Finish(Termination::kFailure,
                  {"Number of consecutive invalid steps more than "
                   "Solver::Options::max_num_consecutive_invalid_steps: ",
                   std::to_string(options_.max_num_consecutive_invalid_steps).c_str()});
  }
  strategy_->StepIsInvalid();
  iteration_.cost = cost_;
  return true;
}

void TrustRegionMinimizer::ComputeCandidate() {
  candidate_cost_ = std::numeric_limits<double>::max();
  is_cut_ = false;
  double cost = 0.0;
  const bool moved = MoveCandidate(step_);
  if (!moved && summary_.failed_step.empty()) {
    summary_.failed_step = "x_plus_delta = Plus(x, delta) failed";
  }
  bool evaluated = moved && EvaluateCandidate(&cost);
  if (IsByMarquardt() && evaluated) {
    ShortenStep(&cost);
  } else if (IsByMarquardt()) {
    evaluated = CutStep(&cost);
  }
  if (evaluated) {
    candidate_cost_ = cost;
    if (inner_iterations_ != nullptr && inner_iterations_->IsDue(cost_ - cost)) {
      RunInnerIterations();
    }
  }
}

bool TrustRegionMinimizer::EvaluateCandidate(double* cost) {
  if (options_.observer != nullptr) {
    options_.observer->BeforeEvaluation(evaluator_.points().candidate().data(), /*jacobians=*/false,
                                        /*new_point=*/true);
  }
  ++summary_.work.num_residual_evaluations;
  const Status evaluated = agreement_.Evaluate(
      [this](double* own) { return evaluator_.EvaluateCandidateCost(own); }, cost);
  clock_.Charge(&summary_.seconds.residuals);
  const bool usable = evaluated.ok() && IsCostUsable(*cost);
  if (!usable && summary_.failed_step.empty()) {
    summary_.failed_step =
        evaluated.ok() ? "the sum of all costs is not finite" : evaluated.message;
  }
  return usable;
}

bool TrustRegionMinimizer::IsCostUsable(double cost) const {
  return loop_.rules == CeresRules::k21 || std::isfinite(cost);
}

// What the landmarks gain by themselves counts as promised, as in Ceres: it says nothing about the
// step's model.
void TrustRegionMinimizer::RunInnerIterations() {
  const double min_gain = kInnerShare * options_.function_tolerance * (cost_ - loop_.fixed_cost) /
                          evaluator_.layout().num_landmarks();
  const double gain = inner_iterations_->Run(min_gain, cost_ - candidate_cost_);
  summary_.work.num_refined_landmarks += inner_iterations_->num_moved();
  inner_iterations_->Pace(gain, cost_ - candidate_cost_);
  candidate_cost_ -= gain;
  model_decrease_ += gain;
  iteration_.model_cost_change = model_decrease_;
}

bool TrustRegionMinimizer::ParameterToleranceReached() {
  if (loop_.rules == CeresRules::k22 && !any_step_accepted_) {
    return false;
  }
  iteration_.step_norm =
      StateDistance(evaluator_.points().current(), evaluator_.points().candidate(), nullptr);
  const double tolerance = options_.parameter_tolerance;
  if (iteration_.step_norm > tolerance * (state_norm_ + tolerance) || IsHeldAtBorder()) {
    return false;
  }
  Finish(Termination::kConvergence,
         {"Parameter tolerance reached. Relative step_norm: ",
          Scientific(iteration_.step_norm / (state_norm_ + tolerance)).text(),
          " <= ", Scientific(tolerance).text(), "."});
  return true;
}

bool TrustRegionMinimizer::FunctionToleranceReached() {
  iteration_.cost_change = cost_ - candidate_cost_;
  // Written so that a NaN cost counts as converged (CeresRules::k21).
  if (std::fabs(iteration_.cost_change) >
          options_.function_tolerance * (cost_ - loop_.fixed_cost) ||
      IsHeldAtBorder()) {
    return false;
  }
  summary_.discarded_cost_change = iteration_.cost_change;
  Finish(Termination::kConvergence, {"Function tolerance reached. |cost_change|/cost: ",
                                     Scientific(std::fabs(iteration_.cost_change) / cost_).text(),
                                     " <= ", Scientific(options_.function_tolerance).text()});
  return true;
}

bool TrustRegionMinimizer::AcceptStep() {
  any_step_accepted_ = true;
  evaluator_.AcceptCandidate();
  state_norm_ = StateNorm();
  const bool recentered = Recenter();
  iteration_.step_is_successful = true;
  iteration_.cost = candidate_cost_;
  if (!recentered && loop_.judge != nullptr && loop_.judge->IsLast(iteration_)) {
    return FinishHere();
  }
  const bool steady =
      options_.reduce_curvature_of_losses && iteration_.cost_change < kSteadyGain * cost_;
  evaluator_.set_loss_curvature(steady ? LossCurvature::kBoth : LossCurvature::kPositive);
  if (!EvaluateGradientAndJacobian(/*new_point=*/false)) {
    return false;
  }
  if (inner_iterations_ != nullptr) {
    candidate_cost_ = cost_;  // summed anew, where gains had been taken off
  }
  iteration_.cost = cost_;
  if (is_cut_) {
    LeaveBorder();
  } else if (iteration_.step_share < kLargeShare) {
    strategy_->StepRejected();
  } else {
    strategy_->StepAccepted(iteration_.relative_decrease);
  }
  if (recentered) {
    quality_ = JudgeFromHere();
  } else {
    quality_->StepAccepted(candidate_cost_, model_decrease_);
  }
  return true;
}

// The judge wants no more than the point just accepted: without Jacobians there. False.
bool TrustRegionMinimizer::FinishHere() {
  cost_ = candidate_cost_;
  return FinalizeIterationAndContinue() &&
         GoesOn(ObserverAction::kTerminateSuccessfully, &summary_.termination, &summary_.message);
}

// At a point just accepted. True if the cost is another function from now on: the best state is
// then looked for anew.
bool TrustRegionMinimizer::Recenter() {
  const int num_recentered = static_cast<int>(agreement_.Sum(evaluator_.Recenter()));
  if (num_recentered == 0) {
    return false;
  }
  summary_.work.num_recentered_factors += num_recentered;
  best_cost_ = std::numeric_limits<double>::max();
  first_comparable_iteration_ = iteration_.iteration;
  return true;
}

StepQuality TrustRegionMinimizer::JudgeFromHere() const {
  return {cost_, options_.use_nonmonotonic_steps ? options_.max_consecutive_nonmonotonic_steps : 0};
}

void TrustRegionMinimizer::RejectStep() {
  iteration_.cost = candidate_cost_;
  if (IsByMarquardt() && !HasCandidate()) {
    LeaveBorder();
  } else {
    strategy_->StepRejected();
  }
}

bool TrustRegionMinimizer::EvaluateGradientAndJacobian(bool new_point) {
  if (options_.observer != nullptr) {
    options_.observer->BeforeEvaluation(evaluator_.points().current().data(), /*jacobians=*/true,
                                        new_point);
  }
  ++summary_.work.num_jacobian_evaluations;
  const auto evaluation = [this, new_point](double* own) {
    return evaluator_.EvaluateJacobians(/*known_point=*/!new_point, own);
  };
  const Status evaluated = agreement_.Evaluate(evaluation, &cost_);
  clock_.Charge(&summary_.seconds.jacobians);
  if (!evaluated.ok() || !IsCostUsable(cost_)) {
    summary_.detail = evaluated.ok() ? "the sum of all costs is not finite" : evaluated.message;
    return Finish(Termination::kFailure, {"Residual and Jacobian evaluation failed."});
  }
  model_.Refresh();
  return ComputeGradientNorms();
}

bool TrustRegionMinimizer::ComputeGradientNorms() {
  const std::vector<double>& g = model_.Gradient();
  std::transform(g.begin(), g.end(), negative_gradient_.begin(),
                 [](double entry) { return -entry; });
  if (!MoveCandidate(negative_gradient_)) {
    return Finish(Termination::kFailure, {"projected_gradient_step = Plus(x, -gradient) failed."});
  }
  iteration_.gradient_norm =
      StateDistance(evaluator_.points().current(), evaluator_.points().candidate(),
                    &iteration_.gradient_max_norm);
  return true;
}

bool TrustRegionMinimizer::MoveCandidate(const std::vector<double>& step) {
  return agreement_.All(evaluator_.points().MoveCandidate(step.data()));
}

double TrustRegionMinimizer::StateNorm() const {
  double sum = 0.0;
  const std::vector<VariableId>& variables = evaluator_.layout().variables;
  for (std::size_t i = 0; i < variables.size(); ++i) {
    if (agreement_.CountsElsewhere(i)) {
      continue;
    }
    const double* x = evaluator_.points().current().data() + graph_.StateOffset(variables[i]);
    for (int k = 0; k < graph_.AmbientSize(variables[i]); ++k) {
      sum += x[k] * x[k];
    }
  }
  return std::sqrt(agreement_.Sum(sum));
}

// ‖a − b‖₂ over the variables that move, and the largest difference.
double TrustRegionMinimizer::StateDistance(const std::vector<double>& a,
                                           const std::vector<double>& b, double* max_norm) const {
  double sum = 0.0;
  double largest = 0.0;
  const std::vector<VariableId>& variables = evaluator_.layout().variables;
  for (std::size_t i = 0; i < variables.size(); ++i) {
    if (agreement_.CountsElsewhere(i)) {
      continue;
    }
    const auto offset = static_cast<std::size_t>(graph_.StateOffset(variables[i]));
    const auto size = static_cast<std::size_t>(graph_.AmbientSize(variables[i]));
    for (std::size_t k = offset; k < offset + size; ++k) {
      const double difference = a[k] - b[k];
      sum += difference * difference;
      largest = std::max(largest, std::fabs(difference));
    }
  }
  if (max_norm != nullptr) {
    *max_norm = agreement_.Max(largest);
  }
  return std::sqrt(agreement_.Sum(sum));
}

bool TrustRegionMinimizer::Finish(Termination termination,
                                  std::initializer_list<const char*> words) {
  summary_.termination = termination;
  summary_.message.clear();
  summary_.message.reserve(120);  // as long as most
  for (const char* word : words) {
    summary_.message += word;
  }
  return false;
}

}  // namespace inceres::internal
