#include "trust_region/trust_region_minimizer.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "trust_region/loop_ends.h"

namespace inceres::internal {

// The loop of docs/ceres_contract.md, "Trust-region loop", member by member in its order: who
// compares traces, or counts calls of user code, sees what Ceres would show. What is not Ceres's
// hangs on options and hooks that are off by default: Marquardt's rule, refinement of landmarks, a
// judge, positions to resume from, factors that move their expansion points.
//
// Three points are kept apart. The evaluator has the current one, where the Jacobians are, and a
// candidate; best_state_ is the cheapest of those that were accepted, and is what is returned. With
// monotonic steps that is the current one, rounding apart.
//
// cost_ is that of the current point and trial_.cost() that of the candidate, which is the largest
// double where it could not be evaluated: such a step fails every test of its cost.

namespace {

// A step that gains less than this share of the cost leaves most residuals about as they were: the
// curvature of their losses counts.
constexpr double kSteadyGain = 0.01;

// A step of which less than this is taken was too long for its model.
constexpr double kLargeShare = 0.25;

// Memory for most solves at once.
constexpr std::size_t kExpectedIterations = 16;

ObserverAction AskObservers(const SolverOptions& options, const IterationSummary& iteration,
                            const double* best_state) {
  if (options.progress) {
    // A table, of which progress gets one line a call.
    if (iteration.iteration == 0) {
      options.progress(ProgressHeading());
    }
    options.progress(ProgressRow(iteration));
  }
  ObserverAction action = ObserverAction::kContinue;
  if (options.observer != nullptr) {
    action = options.observer->EndOfIteration(iteration, best_state);
  }
  // Both may be set: the callback is not asked once the observer ends the solve.
  return action == ObserverAction::kContinue && options.callback
             ? options.callback(iteration, best_state)
             : action;
}

double MaxNorm(const double* begin, const double* end) {
  return std::accumulate(begin, end, 0.0, [](double largest, double entry) {
    return std::max(largest, std::fabs(entry));
  });
}

// Ceres's measure: how far x moves along the negative gradient, ‖x − Plus(x, −g)‖ in the ambient
// space, clamped to the bounds. The candidate's place is borrowed for it: no step is on trial. The
// step is overwritten: the last one is taken, or refused, and the next one is not there yet.
bool FindGradientNorms(const LoopOptions& loop, bool is_constrained, const std::vector<double>& g,
                       LoopEvaluation* evaluation, std::vector<double>* step,
                       IterationSummary* iteration) {
  std::transform(g.begin(), g.end(), step->begin(), [](double entry) { return -entry; });
  if (!evaluation->MoveCandidate(*step)) {
    return false;
  }
  double& max_norm = iteration->gradient_max_norm;
  iteration->gradient_norm = evaluation->CandidateDistance(&max_norm);
  // A maximum may pass over entries that are no number, which is left to Ceres alone.
  if (!loop.nan_gradient_is_small && std::isnan(iteration->gradient_norm)) {
    max_norm = iteration->gradient_norm;
  }
  // Where residuals are tiny x − g rounds to x, which Ceres takes for convergence: it is g then.
  if (loop.judge != nullptr && !is_constrained && max_norm == 0.0) {
    max_norm = MaxNorm(g.data(), g.data() + g.size());
  }
  return true;
}

// Whether the step moves no variable by more than rounding may have moved it: operations on numbers
// of full size that its values are taken to come of, times ε.
bool IsWithinRounding(const Evaluator& evaluator, const std::vector<double>& step) {
  constexpr double kRounding = 16.0 * std::numeric_limits<double>::epsilon();
  const Layout& layout = evaluator.layout();
  const FactorGraph& graph = evaluator.graph();
  for (std::size_t v = 0; v < layout.variables.size(); ++v) {
    const VariableId id = layout.variables[v];
    const double* const x = evaluator.points().current().data() + graph.StateOffset(id);
    const double moved =
        MaxNorm(step.data() + layout.packed_offset[v], step.data() + layout.packed_offset[v + 1]);
    if (!(moved <= kRounding * MaxNorm(x, x + graph.AmbientSize(id)))) {
      return false;
    }
  }
  return true;
}

}  // namespace

TrustRegionMinimizer::TrustRegionMinimizer(const SolverOptions& options, const LoopOptions& loop,
                                           Evaluator* evaluator, LinearModel* model,
                                           TrustRegionMemory* memory, Summary* summary)
    : options_(options),
      loop_(loop),
      evaluator_(*evaluator),
      model_(*model),
      summary_(*summary),
      start_time_(clock_.now()),
      parts_{options, loop, *evaluator, *model, *memory, clock_, *summary},
      evaluation_(parts_),
      trial_(parts_, &evaluation_),
      step_solve_(parts_, &trial_),
      line_search_(parts_, &evaluation_),
      best_state_(evaluator->points(), &memory->best_state),
      strategy_(memory->strategy),
      best_cost_(std::numeric_limits<double>::max()) {
  // From here on clock_ is read at the borders of stages, and each stage charges what went by
  // since.
  model->TimeInto(&summary->seconds, &clock_);
  model->BeginSolve();
  trial_.step().assign(static_cast<std::size_t>(evaluator->layout().size()), 0.0);
}

void TrustRegionMinimizer::Minimize() {
  iteration_start_time_ = start_time_;
  summary_.num_successful_steps = 0;
  summary_.num_unsuccessful_steps = 0;
  summary_.is_constrained = evaluator_.points().IsConstrained();
  summary_.iterations.reserve(kExpectedIterations);
  // Without bounds the start is where the user has put it, to the bit.
  if ((summary_.is_constrained && !ProjectStart()) || !EvaluateStart()) {
    return;
  }
  while (FinalizeIterationAndContinue()) {
    BeginIteration();
    if (!step_solve_.Run(&iteration_)) {
      return;
    }
    if (!iteration_.step_is_valid) {
      // An invalid step evaluates nothing: the row repeats the cost, and its step is 0.
      iteration_.cost = cost_;
      if (!step_solve_.GoOnWithout()) {
        return;
      }
      continue;
    }
    // Before the line search, which evaluates costs already.
    if (!IsWorthTrying()) {
      return;
    }
    if (summary_.is_constrained && options_.max_num_line_search_step_size_iterations > 0) {
      line_search_.Shorten(cost_, &trial_.step());
    }
    trial_.Run(cost_, &iteration_);
    // Before the step is judged: what ends the solve is not recorded as an iteration, and not
    // taken.
    if (TolerancesReached()) {
      return;
    }
    iteration_.relative_decrease = quality_->Evaluate(trial_.cost(), trial_.promise());
    // A NaN ratio is no acceptance.
    if (trial_.descent_was_useful() ||
        iteration_.relative_decrease > options_.min_relative_decrease) {
      if (!AcceptStep()) {
        return;
      }
    } else {
      RejectStep(trial_.cost());
      if (evaluation_.TakesCurvatureBack() && !Linearize(/*new_point=*/true)) {
        return;
      }
    }
  }
}

// Of the iteration before only the gradient's norms are carried on, since a step that is refused
// has none of its own.
void TrustRegionMinimizer::BeginIteration() {
  iteration_start_time_ = clock_.now();
  const IterationSummary previous = iteration_;
  iteration_ = IterationSummary();
  iteration_.iteration = previous.iteration + 1;
  iteration_.gradient_norm = previous.gradient_norm;
  iteration_.gradient_max_norm = previous.gradient_max_norm;
  // A restart forgets what steps have taught; a widened radius is for this step alone.
  if (loop_.judge != nullptr) {
    strategy_->Restart(loop_.judge->RestartRadius());
    strategy_->Widen(loop_.judge->LeastRadius());
    strategy_->Hold(trial_.Hold(loop_.judge->HoldsRefusing()));
  }
  iteration_.trust_region_radius =
      strategy_->Radius();  // of this step; at its end that of the next
}

// A step that has a model decrease; false: the judge ends the solve without it.
bool TrustRegionMinimizer::IsWorthTrying() {
  return loop_.judge == nullptr ||
         loop_.judge->IsWorthTrying(
             iteration_, {cost_, strategy_->HeldBack(model_, trial_.step()),
                          IsWithinRounding(evaluator_, trial_.step()), trial_.num_refusing()}) ||
         GoesOn(ObserverAction::kTerminateSuccessfully, &summary_.termination, &summary_.message);
}

// Plus(x, 0) clamps to the bounds. The norm of the state is known from here on, so that
// parameter_tolerance of Ceres 2.1 counts before the first accepted step (docs/ceres_contract.md).
bool TrustRegionMinimizer::ProjectStart() {
  std::vector<double>& none = trial_.step();
  std::fill(none.begin(), none.end(), 0.0);
  if (!evaluator_.points().MoveCandidate(none.data())) {
    return Finish(Termination::kFailure,
                  {"Unable to project initial point onto the feasible set."});
  }
  evaluator_.AcceptCandidate();
  state_norm_ = evaluation_.StateNorm();
  return true;
}

// Iteration 0: Jacobians, and what is measured once, the scale of the columns and the cost that
// non-monotonic steps refer to. It counts as a successful step.
bool TrustRegionMinimizer::EvaluateStart() {
  iteration_ = IterationSummary();
  // Ceres's correction: the evaluator may come from a solve that ended with another one.
  evaluator_.set_loss_curvature(LossCurvature::kPositive);
  Recenter();
  if (!Linearize(/*new_point=*/true)) {
    // In the place of what Linearize has said.
    return loop_.rules == CeresRules::k22 &&
           Finish(Termination::kFailure, {"Initial residual and Jacobian evaluation failed."});
  }
  std::vector<double>& scale = parts_.memory.scale;
  JacobiScale(model_.Diagonal(), options_.jacobi_scaling, loop_.MostColumnNorm(), &scale);
  // The scale is that of the solve's own iteration 0, not of the point where it goes on.
  if (loop_.resume != nullptr) {
    scale = loop_.resume->scale;
  }
  model_.ScaleColumnsBy(scale);
  // It stays where it is: model and strategy keep its address.
  StartStrategy(options_, scale, &strategy_);
  quality_ = JudgeFromHere();
  iteration_.cost = summary_.initial_cost = cost_;
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
  // FinalizeIterationAndContinue counts the iteration once more.
  summary_.num_successful_steps = position.num_successful_steps - 1;
  summary_.num_unsuccessful_steps = position.num_unsuccessful_steps;
  step_solve_.set_num_invalid(position.num_consecutive_invalid_steps);
  any_step_accepted_ = position.any_step_accepted;
  state_norm_ = any_step_accepted_ ? evaluation_.StateNorm() : state_norm_;
  return true;
}

// After the radius has been updated, so that who resumes begins the next iteration as this solve
// does. The iteration that a resumed solve begins with was kept before.
void TrustRegionMinimizer::KeepPosition() {
  const bool again = loop_.resume != nullptr && loop_.resume->iteration == iteration_.iteration;
  if (loop_.keeper == nullptr || again || !loop_.keeper->Wants(iteration_.iteration)) {
    return;
  }
  LoopPosition position;
  position.iteration = iteration_.iteration;
  position.initial_cost = summary_.initial_cost;
  position.any_step_accepted = any_step_accepted_;
  position.num_consecutive_invalid_steps = step_solve_.num_invalid();
  position.num_successful_steps = summary_.num_successful_steps;
  position.num_unsuccessful_steps = summary_.num_unsuccessful_steps;
  position.strategy = strategy_->Save();
  position.scale = parts_.memory.scale;
  loop_.keeper->Keep(position, evaluator_.points().current());
}

// Ceres's order: lowest iterate, radius and times, the row, callbacks, and only then the tests that
// end the solve, so that callbacks see every row.
bool TrustRegionMinimizer::FinalizeIterationAndContinue() {
  if (iteration_.step_is_successful) {
    ++summary_.num_successful_steps;
    // Negated: a cost that is NaN is no new minimum.
    iteration_.step_is_nonmonotonic = !(cost_ < best_cost_);
    if (!iteration_.step_is_nonmonotonic) {
      best_cost_ = cost_;
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

  // What a callback says goes before limits and convergence.
  if (!CallbacksContinue()) {
    return false;
  }
  // The largest of all processes' times: they must end together.
  const double elapsed = clock_.now() - start_time_ + loop_.seconds_spent_before;
  return GoesOnAfter(iteration_, evaluation_.agreement().Max(elapsed), options_, loop_, &summary_);
}

bool TrustRegionMinimizer::CallbacksContinue() {
  // No process asks if none has anybody to ask; otherwise all take part, for the answer is to be
  // the same in each.
  if (evaluation_.agreement().All(options_.observer == nullptr && !options_.progress &&
                                  !options_.callback)) {
    return true;
  }
  const ObserverAction action = evaluation_.agreement().Ask(
      [this] { return AskObservers(options_, iteration_, best_state().data()); });
  // User code's time belongs to no stage.
  clock_.Read();
  return GoesOn(action, &summary_.termination, &summary_.message);
}

// Ceres asks before a candidate is accepted. CeresRules::k22 leaves the norm of the first steps 0.
bool TrustRegionMinimizer::TolerancesReached() {
  // A step that is short, or gains little, only because a border held it is no sign of a minimum.
  const bool counts =
      !trial_.IsHeldAtBorder() && (loop_.judge == nullptr || loop_.judge->MayEndByTolerance());
  // Up to 2.1 state_norm_ is −1 before the first accepted step, which no step is short against.
  if (loop_.rules == CeresRules::k21 || any_step_accepted_) {
    iteration_.step_norm = evaluation_.CandidateDistance(nullptr);
    if (counts && EndsByParameterTolerance(iteration_.step_norm, state_norm_,
                                           options_.parameter_tolerance, &summary_)) {
      return true;
    }
  }
  iteration_.cost_change = cost_ - trial_.cost();
  return counts && EndsByFunctionTolerance(iteration_.cost_change, cost_, loop_.fixed_cost,
                                           options_.function_tolerance, &summary_);
}

// The candidate becomes the current point. Factors may move their expansion points now, before the
// Jacobians: these are of the new cost, and no cost from before is compared with one from after.
bool TrustRegionMinimizer::AcceptStep() {
  any_step_accepted_ = true;
  evaluator_.AcceptCandidate();
  state_norm_ = evaluation_.StateNorm();
  const bool recentered = Recenter();
  iteration_.step_is_successful = true;
  // For the judge; summed anew with the Jacobians below.
  iteration_.cost = trial_.cost();
  // After a move of the expansion points the candidate's cost is of a function that is gone.
  if (!recentered && loop_.judge != nullptr && loop_.judge->IsLast(iteration_)) {
    return FinishHere();
  }
  // The second-order term of losses with ρ'' < 0, only where residuals change little
  // (docs/algorithms.md, "Robust losses"). By default it stays off, as in Ceres.
  const bool steady =
      options_.reduce_curvature_of_losses && iteration_.cost_change < kSteadyGain * cost_;
  evaluator_.set_loss_curvature(steady ? LossCurvature::kBoth : LossCurvature::kPositive);
  // The cost has been asked for there: evaluation callbacks are told so.
  if (!evaluation_.Jacobians(/*new_point=*/false, &cost_)) {
    best_state_.Follow(false);
    return !recentered && loop_.judge != nullptr && loop_.judge->TakesBack() ? TakeBack()
                                                                             : FailToLinearize();
  }
  best_state_.Follow(cost_ < best_cost_);
  if (!UpdateModel()) {
    return false;
  }
  iteration_.cost = cost_;
  // With the gain ratio of the step as it was tried.
  AdaptRadius();
  if (recentered) {
    quality_ = JudgeFromHere();
  } else {
    // summed anew, where gains had been taken off
    quality_->StepAccepted(trial_.RefinesLandmarks() ? cost_ : trial_.cost(), trial_.promise());
  }
  return true;
}

// After a step that was accepted.
void TrustRegionMinimizer::AdaptRadius() {
  if (trial_.is_cut()) {
    LeaveBorder();
  } else if (iteration_.step_share < kLargeShare) {
    // Taken, but at less than a quarter of its length: the next one is damped as after a refusal.
    strategy_->StepRejected();
  } else {
    strategy_->StepAccepted(iteration_.relative_decrease);
  }
}

// All lengths of this step have been tried: much more damping is to turn the next one.
void TrustRegionMinimizer::LeaveBorder() {
  // By Marquardt's rule each is ten times the damping.
  strategy_->StepRejected();
  strategy_->StepRejected();
}

// The judge wants no more than the point just accepted: without Jacobians there. False.
bool TrustRegionMinimizer::FinishHere() {
  cost_ = trial_.cost();
  best_state_.Follow(cost_ < best_cost_);
  // Ends in either case: by what ends a solve between iterations, or in the words of a user's
  // success.
  return FinalizeIterationAndContinue() &&
         GoesOn(ObserverAction::kTerminateSuccessfully, &summary_.termination, &summary_.message);
}

// At a point just accepted. True if the cost is another function from now on: the best state is
// then looked for anew.
bool TrustRegionMinimizer::Recenter() {
  const int num_recentered = evaluation_.Recenter();
  if (num_recentered == 0) {
    return false;
  }
  summary_.work.num_recentered_factors += num_recentered;
  best_cost_ = std::numeric_limits<double>::max();
  first_comparable_iteration_ = iteration_.iteration;
  return true;
}

// The reference of non-monotonic steps is the cost at hand: what was before is forgotten.
StepQuality TrustRegionMinimizer::JudgeFromHere() const {
  return {cost_, options_.use_nonmonotonic_steps ? options_.max_consecutive_nonmonotonic_steps : 0};
}

// Where there are no Jacobians no solve goes on: the step has led beyond a border.
bool TrustRegionMinimizer::TakeBack() {
  evaluator_.points().SetCurrent(best_state_.get());
  best_state_.Follow(true);
  state_norm_ = evaluation_.StateNorm();
  iteration_.step_is_successful = false;
  // The culprit has ended a step, not the solve.
  if (summary_.failed_step.empty()) {
    summary_.failed_step = summary_.detail;
  }
  summary_.detail.clear();
  trial_.NoteRefusal();
  RejectStep(std::numeric_limits<double>::max());
  return Linearize(/*new_point=*/true);
}

// Ceres records the cost of what was refused: the largest number if it could not be evaluated.
void TrustRegionMinimizer::RejectStep(double cost) {
  iteration_.cost = cost;
  if (options_.strategy == TrustRegionStrategyKind::kMarquardt &&
      cost >= std::numeric_limits<double>::max()) {
    LeaveBorder();
  } else {
    strategy_->StepRejected();
  }
}

// Costs and Jacobians at the current point, and all that follows from them alone: H and η in the
// model, the gradient's norms.
bool TrustRegionMinimizer::Linearize(bool new_point) {
  return evaluation_.Jacobians(new_point, &cost_) ? UpdateModel() : FailToLinearize();
}

bool TrustRegionMinimizer::UpdateModel() {
  model_.Refresh();
  return FindGradientNorms(loop_, summary_.is_constrained, model_.Gradient(), &evaluation_,
                           &trial_.step(), &iteration_) ||
         Finish(Termination::kFailure, {"projected_gradient_step = Plus(x, -gradient) failed."});
}

bool TrustRegionMinimizer::FailToLinearize() {
  return Finish(Termination::kFailure, {"Residual and Jacobian evaluation failed."});
}

bool TrustRegionMinimizer::Finish(Termination termination,
                                  std::initializer_list<const char*> words) {
  return EndSolve(termination, words, &summary_);
}

}  // namespace inceres::internal
