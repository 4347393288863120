#include "incremental/incremental_minimizer.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/stopwatch.h"

namespace inceres::internal {
namespace {

RebuildRule RuleOf(RebuildPolicy policy) {
  return policy == RebuildPolicy::kAlways  ? RebuildRule::kAlways
         : policy == RebuildPolicy::kNever ? RebuildRule::kNever
                                           : RebuildRule::kWhenCheaper;
}

}  // namespace

IncrementalMinimizer::IncrementalMinimizer(const IncrementalOptions& options, const Tuning& tuning,
                                           IncrementalSystem* system)
    : options_(options),
      tuning_(tuning),
      system_(*system),
      control_(tuning, options, options.initial_damping),
      relinearization_(tuning.relinearize, system),
      frame_step_(options, system->executor()),
      active_(tuning.truncate),
      new_frame_step_(tuning.truncate) {
}

void IncrementalMinimizer::Minimize(bool mostly_new, const std::atomic<bool>& stop,
                                    UpdateTrace* trace) {
  trace_ = trace;
  summary_ = &trace->summary();
  for (bool go_on = Begin(mostly_new, stop); go_on; go_on = EndIteration()) {
    if (OutOfBudget(stop)) {
      return Finish(Termination::kNoConvergence,
                    "Stopped by a limit or by request; the state is the best so far.");
    }
    const Verdict tolerances = JudgeTolerances();
    const Verdict verdict = tolerances == Verdict::kGoOn ? Iterate() : tolerances;
    if (tolerances != Verdict::kGoOn || verdict == Verdict::kFailed) {
      return;  // with the reason in the summary
    }
    if (verdict == Verdict::kConverged) {
      return Finish(Termination::kConvergence,
                    "What is left undone is below the function tolerance.");
    }
    if (verdict == Verdict::kStuck) {
      if (EndIteration()) {
        Finish(Termination::kNoConvergence,
               "Steps are refused until damping leaves nothing to gain.");
      }
      return;
    }
    if (!Relinearize()) {
      return;
    }
  }
}

// Linearizes what is dirty; new frames take their steps. False if the Update is over.
bool IncrementalMinimizer::Begin(bool mostly_new, const std::atomic<bool>& stop) {
  state_ = UpdateState();
  state_.mostly_new = mostly_new;
  state_.shares = SharesOf(options_, system_.schur().structure().num_landmarks());
  control_ = StepControl(tuning_, options_, control_.mu());
  relinearization_.Begin(options_, state_.shares.relinearization);
  active_.Clear();
  const bool begins = summary_->iterations.empty();  // or the batch solver has told of the start
  const bool new_frames_first = TakesNewFrameSteps();
  LookAtReweighed();
  if (!(new_frames_first ? LinearizeDirty() : Relinearize())) {
    return false;
  }
  const StoppingRule before = stop_;
  stop_ = StoppingRule(tuning_.stop, options_.function_tolerance, options_.fixed_cost,
                       system_.RoundingOfCost(), summary_->num_iterations, system_.cost());
  if (begins) {
    stop_.GoOnFrom(before);
    state_.left_at_most = MostLeft();
  }
  left_ = HUGE_VAL;
  if (begins) {
    summary_->initial_cost = system_.cost();
  }
  const bool go_on = !begins || EndIteration();
  return go_on && (!new_frames_first || (StepNewFrames(stop) && Relinearize()));
}

void IncrementalMinimizer::Finish(Termination termination, const char* message) {
  summary_->termination = termination;
  summary_->message = message;
  summary_->ended_by_batch_rule = false;
  if (termination == Termination::kConvergence) {
    left_ = summary_->remaining_decrease;
    left_at_cost_ = system_.cost();
    system_.WatchGrowth();
  }
}

// False if the observer ends the Update.
bool IncrementalMinimizer::EndIteration() {
  UpdateIteration& row = trace_->row();
  row.damping = control_.mu();
  row.trust_region_radius = control_.radius();
  if (trace_->observed()) {
    system_.schur().RhsNorms(&row.gradient_max_norm, &row.gradient_norm);
  }
  return trace_->EndRow(system_.cost());
}

bool IncrementalMinimizer::OutOfBudget(const std::atomic<bool>& stop) const {
  return summary_->num_iterations >= options_.max_num_iterations ||
         stop.load(std::memory_order_relaxed) ||
         summary_->num_evaluated_factors + summary_->num_relinearized_factors >=
             options_.max_factor_evaluations ||
         NowInSeconds() - trace_->start_seconds() >= options_.max_solver_time_in_seconds;
}

double IncrementalMinimizer::LandmarkDamping() const {
  return options_.damping == DampingForm::kThesis
             ? 0.0
             : std::max(control_.mu(), tuning_.landmarks.min_damping);
}

bool IncrementalMinimizer::Relinearize() {
  const StageTimer timer(&summary_->linearize_seconds);
  system_.RedampAbove(tuning_.landmarks.outdated_damping * LandmarkDamping());
  RelinearizeWork work;
  return Count(system_.Relinearize(LandmarkDamping(), RuleOf(options_.rebuild), &work), work);
}

// Before anything is linearized: what has other weights only is not, unless its old linearization
// errs too much for them.
void IncrementalMinimizer::LookAtReweighed() {
  const StageTimer timer(&summary_->linearize_seconds);
  const std::vector<FactorRef>& reweighed = system_.Reweigh();
  summary_->num_reweighed_factors += static_cast<int>(reweighed.size());
  if (!reweighed.empty()) {
    relinearization_.LookAt(reweighed, Tolerance());
  }
}

bool IncrementalMinimizer::LinearizeDirty() {
  const StageTimer timer(&summary_->linearize_seconds);
  RelinearizeWork work;
  return Count(system_.LinearizeDirty(&work), work);
}

// False if the linearization failed.
bool IncrementalMinimizer::Count(const Status& status, const RelinearizeWork& work) {
  summary_->num_relinearized_factors += work.num_factors;
  summary_->num_recentered_factors += work.num_recentered;
  summary_->num_eliminated_landmarks += work.num_landmarks;
  summary_->num_rebuilds += work.rebuilt ? 1 : 0;
  summary_->num_drifted_frames += work.num_drifted_frames;
  if (!status.ok()) {
    Finish(Termination::kFailure, status.message.c_str());
  }
  return status.ok();
}

// What the landmarks could gain by themselves.
double IncrementalMinimizer::LandmarkGain() {
  return system_.schur().gains().Total(tuning_.truncate.sum_share * stop_.Allowed(system_.cost()));
}

// Landmarks that could still gain much by themselves, most of them outliers that a robust loss lets
// converge slowly, go ahead without the frames: a pass costs their own factors only. True if any
// moved.
bool IncrementalMinimizer::StepLandmarks() {
  IncrementalSchur& schur = system_.schur();
  const double gain = LandmarkGain();
  if (state_.num_landmark_refinements <= 0 ||
      gain <= tuning_.landmarks.share * stop_.Allowed(system_.cost())) {
    return false;
  }
  --state_.num_landmark_refinements;
  const StageTimer timer(&summary_->landmark_seconds);
  const double cost = system_.cost();
  int num_evaluated = 0;
  const bool moved =
      system_.StepLandmarks(schur.gains().Above(tuning_.landmarks.share * gain /
                                                std::max(1, schur.structure().num_landmarks())),
                            &num_evaluated);
  ++summary_->num_landmark_refinements;
  summary_->num_evaluated_factors += num_evaluated;
  if (moved) {
    UpdateIteration& row = trace_->row();
    row.step = UpdateStep::kLandmarks;
    row.step_is_successful = true;
    row.cost_change = cost - system_.cost();
    stop_.LandmarksGained(row.cost_change, gain);
    row.step_norm = system_.step().Norm();
    relinearization_.MarkStale(Tolerance());
    system_.step().End();
  }
  return moved;
}

Status IncrementalMinimizer::LinearizeAnew() {
  const double damping =
      options_.damping == DampingForm::kThesis ? 0.0 : tuning_.landmarks.min_damping;
  RelinearizeWork work;
  return system_.Relinearize(damping, RuleOf(options_.rebuild), &work);
}

Status IncrementalMinimizer::FactorizeAnew() {
  const Status linearized = LinearizeAnew();
  return linearized.ok()
             ? frame_step_.FactorizeOnly(options_.damping, options_.min_damping, &system_.schur())
             : linearized;
}

// What a change of a frame's step must be worth to be noticed.
double IncrementalMinimizer::Wildfire() const {
  return tuning_.truncate.wildfire_share * Tolerance() /
         std::max(1, system_.schur().structure().num_frames());
}

// kSingular if there is no factor.
Status IncrementalMinimizer::FactorizeFrames() {
  const StageTimer timer(&summary_->solve_seconds);
  factored_mu_ = control_.mu();
  return frame_step_.Factorize(options_.damping, control_.mu(), &system_.schur(), trace_);
}

// δ_c
Status IncrementalMinimizer::SolveFrames() {
  const StageTimer timer(&summary_->solve_seconds);
  return frame_step_.Solve(Wildfire(), &system_.schur(), trace_);
}

// What the model promises for the whole step, all of it still undone; false: not before the step is
// known.
bool IncrementalMinimizer::SeesLeft(double landmark_gain) {
  const StageTimer timer(&summary_->solve_seconds);
  double gain = 0.0;
  const bool sees = frame_step_.FindGain(&system_.schur(), &gain);
  summary_->remaining_decrease = landmark_gain + gain;
  return sees;
}

bool IncrementalMinimizer::IsLittleLeft(double landmark_gain) {
  control_.Sees(summary_->remaining_decrease);
  return stop_.IsLittleLeft(summary_->remaining_decrease, landmark_gain, system_.cost(),
                            summary_->num_iterations, state_.mostly_new);
}

IncrementalMinimizer::Verdict IncrementalMinimizer::Iterate() {
  if (StepLandmarks()) {
    return Verdict::kGoOn;
  }
  ++summary_->num_iterations;
  const EarlierFactor earlier = AskEarlierFactor();
  if (earlier == EarlierFactor::kLittleLeft || LittleHasCome()) {
    return ClaimConvergence();
  }
  const double landmark_gain = LandmarkGain();
  bool sees_left = earlier == EarlierFactor::kStep;
  Status solved;
  if (!sees_left) {
    solved = FactorizeFrames();
    sees_left = solved.ok() && SeesLeft(landmark_gain);
  }
  if (sees_left && IsLittleLeft(landmark_gain)) {
    return ClaimConvergence();
  }
  solved = solved.ok() ? SolveFrames() : solved;
  if (solved.code == StatusCode::kSingular) {
    return Retreat(false);
  }
  if (!solved.ok()) {
    Finish(Termination::kFailure, solved.message.c_str());
    return Verdict::kFailed;
  }
  // else all there is to gain is not known
  const bool solved_to_the_end = frame_step_.work().converged;
  if (!sees_left) {
    summary_->remaining_decrease = frame_step_.AddGain(landmark_gain);
    if (IsLittleLeft(landmark_gain) && solved_to_the_end) {
      return ClaimConvergence();
    }
  }
  const double remaining = summary_->remaining_decrease;
  if (state_.frames_moved && !state_.mostly_new &&
      landmark_gain > tuning_.landmarks.dominance * remaining) {
    state_.frames_moved = false;
    state_.num_landmark_refinements = options_.max_landmark_refinements;
    if (StepLandmarks()) {
      return Verdict::kGoOn;
    }
  }
  SelectActive(remaining);
  bool refreshed = false;
  if (TakeStep(&refreshed)) {
    return Verdict::kGoOn;
  }
  system_.step().Reject();
  // Where fresh Jacobians promise so little, and not even that is kept, or the cost does not change
  // at all, there is nothing to be had by more damping.
  const bool in_vain = !refreshed && !control_.IsDampedHard() && solved_to_the_end &&
                       !system_.step().is_cut_off() &&
                       stop_.IsVain(remaining, trace_->row().cost_change, system_.cost());
  return in_vain && !relinearization_.RefreshAged(Tolerance()) ? Verdict::kConverged
                                                               : Retreat(refreshed);
}

// Little is left by the model: it is believed once its Jacobians are fresh enough and its damping
// is near the floor.
IncrementalMinimizer::Verdict IncrementalMinimizer::ClaimConvergence() {
  trace_->row().refreshed = relinearization_.RefreshAged(Tolerance());
  if (trace_->row().refreshed || control_.RelaxOnce()) {
    return Verdict::kGoOn;
  }
  if (!control_.IsDampedHard()) {
    return FreeHeldLandmarks() ? Verdict::kGoOn : Verdict::kConverged;
  }
  switch (control_.JudgeRefusals(Tolerance())) {
    case StepControl::Verdict::kMinimum:
      return Verdict::kConverged;
    case StepControl::Verdict::kRefusals:
      summary_->rests_on_refusals = true;
      return Verdict::kConverged;
    case StepControl::Verdict::kUnknown:
      return Verdict::kStuck;
    default:
      return Verdict::kGoOn;
  }
}

// Far points are damped by more than the frames, or they would run away along their rays: for a
// claim they are damped as little, where that shows more to gain than may be left undone. Once a
// step.
bool IncrementalMinimizer::FreeHeldLandmarks() {
  if (state_.landmarks_freed ||
      !system_.RedampHidden(control_.mu(), stop_.Allowed(system_.cost()))) {
    return false;
  }
  const StageTimer timer(&summary_->linearize_seconds);
  state_.landmarks_freed = true;
  trace_->row().refreshed = true;
  RelinearizeWork work;
  return Count(system_.Relinearize(control_.mu(), RuleOf(options_.rebuild), &work), work);
}

// What moves. A problem that is new for the most part is far from its minimum, where half a step
// leads elsewhere than a whole one: all of it moves. So it does if the user wants nothing
// truncated.
void IncrementalMinimizer::SelectActive(double remaining) {
  const StageTimer timer(&summary_->select_seconds);
  const double allowed = stop_.Allowed(system_.cost());
  const bool all = state_.mostly_new || state_.shares.truncation == 0.0;
  const double budget =
      all ? -1.0 : std::max(state_.shares.truncation * remaining, tuning_.truncate.floor * allowed);
  active_.Select(frame_step_.values(), frame_step_.reduced(), frame_step_.work().solved,
                 {budget, Wildfire(), remaining - LandmarkGain()}, &system_);
  summary_->num_moved_frames += static_cast<int>(active_.frames().size());
  summary_->num_visited_landmarks += static_cast<int>(active_.landmarks().size());
}

// Tries the step, within the trust region once there is one. A step that is refused with no old
// Jacobian to blame is tried again along the dog-leg path: that costs an evaluation, where more
// damping costs a factorization too.
bool IncrementalMinimizer::TakeStep(bool* refreshed) {
  double norm = -1.0;  // looked for when it is needed: mostly the radius is infinite
  if (control_.radius() < HUGE_VAL) {
    norm = system_.step().ScaledNorm();
    if (norm > control_.radius()) {
      norm = control_.radius();
      system_.step().Shorten(norm);
      trace_->row().shortened = true;
    }
  }
  for (int attempt = 0;; ++attempt) {
    double ratio = 0.0;
    const bool accepted = EvaluateStep(&ratio) && ratio > options_.min_relative_decrease;
    if (norm < 0.0 && !(accepted && control_.IsGood(ratio))) {
      norm = system_.step().ScaledNorm();
    }
    if (accepted) {
      control_.AdaptRadius(ratio, norm);
      Accept(ratio);
      return true;
    }
    *refreshed =
        relinearization_.RefreshTouched(/*evaluated=*/trace_->row().model_cost_change > 0.0);
    if (*refreshed || !control_.MayShorten(attempt)) {
      control_.GiveUpRadius();
      return false;
    }
    ++summary_->num_shortened_steps;
    trace_->row().shortened = true;
    norm = control_.Shorten(norm);
    system_.step().Shorten(norm);
  }
}

bool IncrementalMinimizer::EvaluateStep(double* gain_ratio) {
  const StageTimer timer(&summary_->evaluate_seconds);
  double change = 0.0;
  double predicted = 0.0;
  const Status status = system_.step().Evaluate(&change, &predicted);
  const bool evaluated = status.ok();
  if (!evaluated && summary_->failed_step.empty()) {
    summary_->failed_step = status.message;
  }
  for (const IncrementalFamily& family : system_.families()) {
    summary_->num_evaluated_factors +=
        static_cast<std::int64_t>(system_.step().Touched(family.id()).size());
  }
  *gain_ratio = evaluated && predicted > 0.0 ? -change / predicted : -1.0;
  UpdateIteration& row = trace_->row();
  row.step = UpdateStep::kFrames;
  row.step_norm = system_.step().Norm();
  row.cost_change = evaluated ? -change : -std::numeric_limits<double>::max();
  row.model_cost_change = evaluated ? predicted : 0.0;
  row.relative_decrease = evaluated ? *gain_ratio : std::numeric_limits<double>::lowest();
  return evaluated;
}

// The step moves the state, and what it touched is looked at.
void IncrementalMinimizer::AcceptStep() {
  const StageTimer timer(&summary_->accept_seconds);
  trace_->row().step_is_successful = true;
  summary_->num_updated_landmarks += system_.AcceptValues();
  relinearization_.MarkStale(Tolerance());
  frame_step_.TakeOff(active_.frames(), &system_);
  system_.step().End();
}

void IncrementalMinimizer::Accept(double gain_ratio) {
  AcceptStep();
  control_.Accept(gain_ratio, trace_->row().shortened);
  const bool shortened = trace_->row().shortened || system_.step().is_cut_off();
  state_.whole_step = shortened ? -1.0 : std::hypot(trace_->row().step_norm, frame_step_.Norm());
  stop_.StepTaken(shortened ? 0.0 : summary_->remaining_decrease, gain_ratio);
  relinearization_.Forgive();
  state_.frames_moved = true;
  state_.landmarks_freed = false;
  NoteStep(gain_ratio, shortened);
}

// Refresh before retreat; then more damping, which the landmarks that would have moved take up too.
IncrementalMinimizer::Verdict IncrementalMinimizer::Retreat(bool refreshed) {
  ++summary_->num_unsuccessful_steps;
  UpdateIteration& row = trace_->row();
  row.refreshed = refreshed;
  if (refreshed) {
    return Verdict::kGoOn;
  }
  // it could not be evaluated
  const bool blindly = row.step == UpdateStep::kFrames && !(row.model_cost_change > 0.0);
  const bool may_go_on = control_.Refuse(summary_->remaining_decrease, blindly);
  for (const std::int32_t landmark : active_.landmarks()) {
    if (options_.damping == DampingForm::kHybrid &&
        system_.schur().blocks().lambda(landmark) < control_.mu()) {
      system_.Redamp(landmark);
    }
  }
  return may_go_on ? Verdict::kGoOn : Verdict::kStuck;
}

}  // namespace inceres::internal
