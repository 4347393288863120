#include "incremental/incremental_minimizer.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/stopwatch.h"

namespace inceres::internal {

// One Update (docs/algorithms.md, from "One Update of incremental mode" on). An iteration solves
//
//     (S + μ diag C) δ_c = b,   δ_l = U_invᵀ (z − Yᵀ δ_c),
//
// moves that part of the frames and landmarks which is worth it, and judges the step by the factors
// it touches. The rule that ends an Update is StoppingRule's, μ and the radius are StepControl's,
// and which Jacobians are renewed Relinearization's; here is the order in which they are asked.
//
// Kept from one Update to the next are μ, the factor of S, the step that was not taken, and what
// the last one left undone. Limits, the stop request and the clock are looked at between iterations
// only: what an iteration decides depends on counts and values alone.
//
// The order of the parts of an iteration is that of their cost: landmarks by themselves, the factor
// of before, a factorization without a backward substitution, the step, its evaluation.

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
  // A limit is looked at before the iteration that would exceed it. Iterate leaves the
  // linearization of what its step has made stale to the line behind it, so that each iteration
  // begins with S and b up to date.
  for (bool go_on = Begin(mostly_new, stop); go_on; go_on = EndIteration()) {
    if (OutOfBudget(stop)) {
      return Finish(Termination::kNoConvergence,
                    "Stopped by a limit or by request; the state is the best so far.");
    }
    const Verdict tolerances = JudgeTolerances();
    const Verdict verdict = tolerances == Verdict::kGoOn ? Iterate() : tolerances;
    // JudgeTolerances finishes by itself, in words of its own.
    if (tolerances != Verdict::kGoOn || verdict == Verdict::kFailed) {
      return;  // with the reason in the summary
    }
    if (verdict == Verdict::kConverged) {
      return Finish(Termination::kConvergence,
                    "What is left undone is below the function tolerance.");
    }
    // The refused iteration still gets its row; an observer that ends the Update there has the last
    // word.
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

// Linearizes what is dirty; new frames take their steps. False if the Update is over. With new
// frames first, factors are linearized but no landmark is eliminated anew: those that the new
// frames see are put into the new rows alone, and into all of S afterwards.
bool IncrementalMinimizer::Begin(bool mostly_new, const std::atomic<bool>& stop) {
  state_ = UpdateState();
  state_.mostly_new = mostly_new;
  state_.shares = SharesOf(options_, system_.schur().structure().num_landmarks());
  // μ goes on from where the last Update left it; the radius and what refusals have proven do not.
  control_ = StepControl(tuning_, options_, control_.mu());
  relinearization_.Begin(options_, state_.shares.relinearization);
  active_.Clear();
  const bool begins = summary_->iterations.empty();  // or the batch solver has told of the start
  const bool new_frames_first = TakesNewFrameSteps();
  LookAtReweighed();
  if (!(new_frames_first ? LinearizeDirty() : Relinearize())) {
    return false;
  }
  // The tolerance is made of the cost and its rounding at the values of now, so the linearization
  // comes first. Whatever the last Update has claimed counts for one that goes on from there, and
  // not after the batch solver.
  const StoppingRule before = stop_;
  stop_ = StoppingRule(tuning_.stop, options_.function_tolerance, options_.fixed_cost,
                       system_.RoundingOfCost(), summary_->num_iterations, system_.cost());
  if (begins) {
    stop_.GoOnFrom(before);
    state_.left_at_most = MostLeft();
  }
  // Until this Update has converged itself.
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
  // The batch phase before has said so of its own end.
  summary_->ended_by_batch_rule = false;
  // What MostLeft builds on, as long as only variables and factors come.
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
  // A pass over all variables, which nobody pays for who does not look on.
  if (trace_->observed()) {
    system_.schur().RhsNorms(&row.gradient_max_norm, &row.gradient_norm);
  }
  return trace_->EndRow(system_.cost());
}

// Counts first; the clock is asked last.
bool IncrementalMinimizer::OutOfBudget(const std::atomic<bool>& stop) const {
  return summary_->num_iterations >= options_.max_num_iterations ||
         stop.load(std::memory_order_relaxed) ||
         summary_->num_evaluated_factors + summary_->num_relinearized_factors >=
             options_.max_factor_evaluations ||
         NowInSeconds() - trace_->start_seconds() >= options_.max_solver_time_in_seconds;
}

// λ = max(μ, λ_min): a far point must not run off along its ray while the frames are hardly damped.
double IncrementalMinimizer::LandmarkDamping() const {
  return options_.damping == DampingForm::kThesis
             ? 0.0
             : std::max(control_.mu(), tuning_.landmarks.min_damping);
}

bool IncrementalMinimizer::Relinearize() {
  const StageTimer timer(&summary_->linearize_seconds);
  // Landmarks that refusals have damped hard come back once μ has come down; those that are damped
  // a little more than today are left, for a change of λ costs an elimination.
  system_.RedampAbove(tuning_.landmarks.outdated_damping * LandmarkDamping());
  RelinearizeWork work;
  // Counted after a failure as well: the work was done.
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
// The sum is kept by difference, and summed anew where rounding may have eaten a share of what the
// Update may leave.
double IncrementalMinimizer::LandmarkGain() {
  return system_.schur().gains().Total(tuning_.truncate.sum_share * stop_.Allowed(system_.cost()));
}

// Landmarks that could still gain much by themselves, most of them outliers that a robust loss lets
// converge slowly, go ahead without the frames: a pass costs their own factors only. True if any
// moved.
bool IncrementalMinimizer::StepLandmarks() {
  IncrementalSchur& schur = system_.schur();
  const double gain = LandmarkGain();
  // A pass is allowed by Iterate after a step of the frames; it is worthwhile while the landmarks
  // hold more than a share of σT.
  if (state_.num_landmark_refinements <= 0 ||
      gain <= tuning_.landmarks.share * stop_.Allowed(system_.cost())) {
    return false;
  }
  --state_.num_landmark_refinements;
  const StageTimer timer(&summary_->landmark_seconds);
  const double cost = system_.cost();
  int num_evaluated = 0;
  const bool moved =
      // Those step whose own gain exceeds a share of the mean: a few outliers mostly hold nearly
      // all of it.
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
    // c of the stopping rule: what landmarks gain over their promise, they may go on to gain.
    stop_.LandmarksGained(row.cost_change, gain);
    row.step_norm = system_.step().Norm();
    // Before the step ends, for it asks which factors were touched.
    relinearization_.MarkStale(Tolerance());
    system_.step().End();
  }
  return moved;
}

// For covariances: with λ_min, whatever μ has been.
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
// A share of T for all frames together, so that what the substitution leaves stays below it.
double IncrementalMinimizer::Wildfire() const {
  return tuning_.truncate.wildfire_share * Tolerance() /
         std::max(1, system_.schur().structure().num_frames());
}

// kSingular if there is no factor.
Status IncrementalMinimizer::FactorizeFrames() {
  const StageTimer timer(&summary_->solve_seconds);
  // An earlier factor is asked only as long as μ is still that of the factor.
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
  // ½ bᵀδ_c = ½ ‖L⁻¹b‖², which takes no backward substitution.
  const StageTimer timer(&summary_->solve_seconds);
  double gain = 0.0;
  const bool sees = frame_step_.FindGain(&system_.schur(), &gain);
  // R = ½ bᵀδ_c + Σ ½ ‖z‖².
  summary_->remaining_decrease = landmark_gain + gain;
  return sees;
}

bool IncrementalMinimizer::IsLittleLeft(double landmark_gain) {
  // Whoever judges refusals later wants to know what was left near the floor.
  control_.Sees(summary_->remaining_decrease);
  return stop_.IsLittleLeft(summary_->remaining_decrease, landmark_gain, system_.cost(),
                            summary_->num_iterations, state_.mostly_new);
}

// A claim of convergence is made as early as possible: from what is known without a factorization,
// then from R with one but without the step, at last from the step. Each goes to ClaimConvergence,
// which may send the loop on.
IncrementalMinimizer::Verdict IncrementalMinimizer::Iterate() {
  // A pass of landmarks has a row of the trace, but solves no reduced system and is not counted as
  // an iteration.
  if (StepLandmarks()) {
    return Verdict::kGoOn;
  }
  ++summary_->num_iterations;
  const EarlierFactor earlier = AskEarlierFactor();
  // AskEarlierFactor comes first, since it is only asked after a step, and LittleHasCome only
  // before.
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
  // With kStep the factor of before gives the step, and `solved` is still OK.
  solved = solved.ok() ? SolveFrames() : solved;
  // The damping is next: without a step there is nothing to shorten, and nothing to blame.
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
  // Landmarks that hold most of R take it by themselves, for the price of their own factors. Once
  // after each step of the frames.
  if (state_.frames_moved && !state_.mostly_new &&
      landmark_gain > tuning_.landmarks.dominance * remaining) {
    state_.frames_moved = false;
    state_.num_landmark_refinements = options_.max_landmark_refinements;
    if (StepLandmarks()) {
      return Verdict::kGoOn;
    }
  }
  // From here on the step under construction has entries: it is accepted or rejected below.
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
  // The same trust rule as for a claim: aged Jacobians may be why nothing is promised.
  return in_vain && !relinearization_.RefreshAged(Tolerance()) ? Verdict::kConverged
                                                               : Retreat(refreshed);
}

// Little is left by the model: it is believed once its Jacobians are fresh enough and its damping
// is near the floor.
IncrementalMinimizer::Verdict IncrementalMinimizer::ClaimConvergence() {
  // In the order of their cost: Jacobians that may mislead, then μ, which begins the factor of S
  // anew, then landmarks, which are eliminated anew.
  trace_->row().refreshed = relinearization_.RefreshAged(Tolerance());
  if (trace_->row().refreshed || control_.RelaxOnce()) {
    return Verdict::kGoOn;
  }
  if (!control_.IsDampedHard()) {
    return FreeHeldLandmarks() ? Verdict::kGoOn : Verdict::kConverged;
  }
  // μ was at its floor, steps were refused there, and it has risen again.
  switch (control_.JudgeRefusals(Tolerance())) {
    case StepControl::Verdict::kMinimum:
      return Verdict::kConverged;
    case StepControl::Verdict::kRefusals:
      summary_->rests_on_refusals = true;
      return Verdict::kConverged;
    case StepControl::Verdict::kUnknown:
      return Verdict::kStuck;
    // kTryBetween: a damping between the last two was set, and the loop goes on with it.
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
  // A second time would find the same until a step is taken; Accept says so.
  state_.landmarks_freed = true;
  trace_->row().refreshed = true;
  RelinearizeWork work;
  // With λ = μ below λ_min: the landmarks are damped like the frames, until they are next
  // eliminated.
  return Count(system_.Relinearize(control_.mu(), RuleOf(options_.rebuild), &work), work);
}

// What moves. A problem that is new for the most part is far from its minimum, where half a step
// leads elsewhere than a whole one: all of it moves. So it does if the user wants nothing
// truncated.
void IncrementalMinimizer::SelectActive(double remaining) {
  const StageTimer timer(&summary_->select_seconds);
  const double allowed = stop_.Allowed(system_.cost());
  const bool all = state_.mostly_new || state_.shares.truncation == 0.0;
  // B of docs/algorithms.md, "Lazy steps". The second term keeps small steps from being truncated
  // to nothing: that much may be left anyway. A negative budget moves all.
  const double budget =
      all ? -1.0 : std::max(state_.shares.truncation * remaining, tuning_.truncate.floor * allowed);
  // The frames' part of R is handed on too, for the partial step measures what it gains against it.
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
    // Cut before it is tried: the radius has been found by steps like this one.
    if (norm > control_.radius()) {
      norm = control_.radius();
      system_.step().Shorten(norm);
      trace_->row().shortened = true;
    }
  }
  // Each turn costs an evaluation of the touched factors. The loop ends with an accepted step, with
  // Jacobians to blame, or when the shortenings are used up.
  for (int attempt = 0;; ++attempt) {
    double ratio = 0.0;
    const bool accepted = EvaluateStep(&ratio) && ratio > options_.min_relative_decrease;
    // A good step with an infinite radius needs no length: the radius stays infinite.
    if (norm < 0.0 && !(accepted && control_.IsGood(ratio))) {
      norm = system_.step().ScaledNorm();
    }
    if (accepted) {
      control_.AdaptRadius(ratio, norm);
      Accept(ratio);
      return true;
    }
    // Refresh before retreat. A step that was not evaluated predicts 0, and all its old Jacobians
    // are renewed.
    *refreshed =
        relinearization_.RefreshTouched(/*evaluated=*/trace_->row().model_cost_change > 0.0);
    if (*refreshed || !control_.MayShorten(attempt)) {
      // Damping takes over, or the next step rests on other Jacobians: either way it is another
      // path.
      control_.GiveUpRadius();
      return false;
    }
    ++summary_->num_shortened_steps;
    trace_->row().shortened = true;
    norm = control_.Shorten(norm);
    system_.step().Shorten(norm);
  }
}

// The gain ratio ϱ over the touched factors; −1 where the step cannot be evaluated or its model
// promises nothing, so that it is refused whatever min_relative_decrease is.
bool IncrementalMinimizer::EvaluateStep(double* gain_ratio) {
  const StageTimer timer(&summary_->evaluate_seconds);
  double change = 0.0;
  double predicted = 0.0;
  const Status status = system_.step().Evaluate(&change, &predicted);
  const bool evaluated = status.ok();
  // The first one of the Update is told.
  if (!evaluated && summary_->failed_step.empty()) {
    summary_->failed_step = status.message;
  }
  for (const IncrementalFamily& family : system_.families()) {
    // Counted also where the evaluation broke off: the budget errs on the safe side.
    summary_->num_evaluated_factors +=
        static_cast<std::int64_t>(system_.step().Touched(family.id()).size());
  }
  *gain_ratio = evaluated && predicted > 0.0 ? -change / predicted : -1.0;
  UpdateIteration& row = trace_->row();
  row.step = UpdateStep::kFrames;
  row.step_norm = system_.step().Norm();
  // A candidate without a cost counts as the largest number.
  row.cost_change = evaluated ? -change : -std::numeric_limits<double>::max();
  row.model_cost_change = evaluated ? predicted : 0.0;
  row.relative_decrease = evaluated ? *gain_ratio : std::numeric_limits<double>::lowest();
  return evaluated;
}

// The step moves the state, and what it touched is looked at.
// Values move before factors are looked at, since the errors of old linearizations follow from the
// residuals there; the lists of the step are needed until the end.
void IncrementalMinimizer::AcceptStep() {
  const StageTimer timer(&summary_->accept_seconds);
  trace_->row().step_is_successful = true;
  summary_->num_updated_landmarks += system_.AcceptValues();
  relinearization_.MarkStale(Tolerance());
  // What was applied is no longer part of the step still to take; the rest stays for the next one.
  frame_step_.TakeOff(active_.frames(), &system_);
  system_.step().End();
}

// What the step tells of the next: μ by its gain ratio, the stopping rule by its promise, and
// whether the factor of S from before it may be asked. A shortened step, or one that bounds cut
// off, promised something else than what was seen left, so it tells nothing of the series.
void IncrementalMinimizer::Accept(double gain_ratio) {
  AcceptStep();
  control_.Accept(gain_ratio, trace_->row().shortened);
  const bool shortened = trace_->row().shortened || system_.step().is_cut_off();
  // After TakeOff: FrameStep::Norm is of what was left out.
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
  // A change of μ does not reach landmarks by itself: λ is that of their elimination.
  for (const std::int32_t landmark : active_.landmarks()) {
    if (options_.damping == DampingForm::kHybrid &&
        system_.schur().blocks().lambda(landmark) < control_.mu()) {
      system_.Redamp(landmark);
    }
  }
  // Beyond max_damping the Update ends without convergence.
  return may_go_on ? Verdict::kGoOn : Verdict::kStuck;
}

}  // namespace inceres::internal
