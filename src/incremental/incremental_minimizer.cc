#include "incremental/incremental_minimizer.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/stopwatch.h"

namespace inceres::internal {
namespace {

// Where nothing is eliminated and no loss bends the cost, the model says nearly all there is to
// gain.
bool IsPlain(const IncrementalSystem& system) {
  return system.schur().structure().num_landmarks() == 0 &&
         std::none_of(system.families().begin(), system.families().end(),
                      [&system](const IncrementalFamily& family) {
                        return system.graph().HasLosses(family.id());
                      });
}

Tuning::Stop StopRulesFor(const IncrementalSystem& system, const IncrementalOptions& options,
                          const Tuning& tuning) {
  Tuning::Stop rules = tuning.stop;
  if (options.max_landmark_refinements == 0) {
    rules.landmarks_share = HUGE_VAL;
  }
  if (IsPlain(system)) {
    rules.share = rules.plain_share;
    rules.factor_growth = HUGE_VAL;  // nothing of the model is asked to be borne out by steps
  }
  return rules;
}

// Of a step that was tried (StepAttempts): whether it has a cost.
bool IsEvaluated(const UpdateIteration& row) {
  return row.cost_change > -std::numeric_limits<double>::max();
}

}  // namespace

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

void IncrementalMinimizer::Minimize(bool mostly_new, const std::atomic<bool>& stop,
                                    UpdateTrace* trace) {
  context_.Begin(mostly_new, stop, trace);
  words_.Forget();
  landmarks_.Begin();
  linearization_.ForgetFreed();
  linearization_.NoteDampedSquare(0.0);
  tolerances_.NoteStep(-1.0);
  earlier_factor_.End(Run());
}

// A limit is looked at before the iteration that would exceed it. Iterate leaves the linearization
// of what its step has made stale to the line behind it, so that each iteration begins with S and b
// up to date.
bool IncrementalMinimizer::Run() {
  for (bool go_on = Begin(); go_on; go_on = context_.EndIteration()) {
    if (context_.OutOfBudget()) {
      context_.Finish(Termination::kNoConvergence,
                      "Stopped by a limit or by request; the state is the best so far.");
      return false;
    }
    // No step was solved for there: what the summary has as left is of before the last one, or of
    // none at all, and the next Update must not build on it.
    if (tolerances_.EndUpdate()) {
      return false;
    }
    const Verdict verdict = Iterate();
    if (verdict == Verdict::kFailed) {
      return false;
    }
    if (verdict == Verdict::kConverged) {
      FinishConverged();
      return true;
    }
    // The refused iteration still gets its row; an observer that ends the Update there has the last
    // word.
    if (verdict == Verdict::kStuck) {
      if (context_.EndIteration()) {
        context_.Finish(Termination::kNoConvergence,
                        "Steps are refused until damping leaves nothing to gain.");
      }
      return false;
    }
    if (!linearization_.Relinearize()) {
      return false;
    }
  }
  return false;
}

// With what the claim rests on.
void IncrementalMinimizer::FinishConverged() {
  const double cost = context_.system.cost();
  if (words_.empty() && context_.stop.stagnated_gain() >= 0.0) {
    words_.Say(
        "Steps stagnate: the last %d iterations have gained %e of the cost, and the model sees "
        "%e left.",
        context_.tuning.stop.stagnation, context_.stop.stagnated_gain() / cost,
        context_.summary->remaining_decrease / cost);
  }
  if (words_.empty()) {
    words_.SayLittleLeft(context_.summary->remaining_decrease, cost,
                         context_.options.function_tolerance);
  }
  words_.MakeRoomIn(&context_.summary->message);
  context_.Finish(Termination::kConvergence, words_.text());
}

// Linearizes what is dirty; new frames take their steps. False if the Update is over. With new
// frames first, factors are linearized but no landmark is eliminated anew: those that the new
// frames see are put into the new rows alone, and into all of S afterwards.
bool IncrementalMinimizer::Begin() {
  UpdateSummary& summary = *context_.summary;
  IncrementalSystem& system = context_.system;
  const bool begins = summary.iterations.empty();  // or the batch solver has told of the start
  const bool new_frames_first = new_frames_.AreWorthwhile();
  linearization_.LookAtReweighed();
  if (!(new_frames_first ? linearization_.LinearizeDirty() : linearization_.Relinearize())) {
    return false;
  }
  // The tolerance is made of the cost and its rounding at the values of now, so the linearization
  // comes first. Whatever the last Update has claimed counts for one that goes on from there, and
  // not after the batch solver, whose last step is to bear out what is claimed next.
  const StoppingRule before = context_.stop;
  context_.stop = StoppingRule(StopRulesFor(system, context_.options, context_.tuning),
                               context_.options.function_tolerance, context_.options.fixed_cost,
                               system.rounding().AtMost(), summary.num_iterations, system.cost());
  if (begins) {
    context_.stop.GoOnFrom(before, system.TakeRewritten());
    summary.initial_cost = system.cost();
  } else if (const UpdateIteration& row = summary.iterations.back();
             row.step == UpdateStep::kBatch && row.step_is_successful) {
    context_.stop.StepTaken(row.model_cost_change, row.cost_change, row.relative_decrease);
  }
  earlier_factor_.Begin(begins);
  const bool go_on = !begins || context_.EndIteration();
  return go_on && (!new_frames_first || (new_frames_.Run() && linearization_.Relinearize()));
}

Status IncrementalMinimizer::FactorizeAnew() {
  const Status linearized = LinearizeAnew();
  return linearized.ok() ? frame_step_.FactorizeWith(context_.options.min_damping) : linearized;
}

// A claim of convergence is made as early as possible: from what is known without a factorization,
// then from R with one but without the step, at last from the step. Each goes to ClaimConvergence,
// which may send the loop on.
IncrementalMinimizer::Verdict IncrementalMinimizer::Iterate() {
  // A pass of landmarks has a row of the trace, but solves no reduced system and is not counted as
  // an iteration.
  if (landmarks_.Step()) {
    return Verdict::kGoOn;
  }
  ++context_.summary->num_iterations;
  const EarlierFactor::Verdict earlier = earlier_factor_.Ask();
  // Ask comes first, since it is only asked after a step, and LittleHasCome only before.
  const bool is_early =
      earlier == EarlierFactor::Verdict::kLittleLeft || earlier_factor_.LittleHasCome();
  double landmark_gain = is_early ? 0.0 : landmarks_.Gain();
  Verdict found = is_early ? Verdict::kConverged : FindStep(earlier, landmark_gain);
  if (found == Verdict::kConverged) {
    found = ClaimConvergence();
    if (found != Verdict::kConverged || context_.control.IsDampedHard() ||
        !context_.stop.WaitForStep()) {
      return found;
    }
    // The model is as good as it gets, and its step tells whether it is right.
    landmark_gain = landmarks_.Gain();
    found = FindStep(EarlierFactor::Verdict::kSaysNothing, landmark_gain);
    if (found == Verdict::kConverged) {
      return ClaimConvergence();
    }
  }
  if (found != Verdict::kGoOn) {
    return found == Verdict::kStuck ? Retreat(false) : found;
  }
  const double remaining = context_.summary->remaining_decrease;
  // If landmarks creep because they are damped, or their Jacobians are old, that ends first.
  if (context_.stop.sees_landmarks_creep() && !context_.control.RefusalsDecide()) {
    found = ClaimConvergence();
    if (found != Verdict::kConverged) {
      return found;
    }
  }
  // Landmarks that hold most of R take it by themselves, for the price of their own factors.
  return landmarks_.StepBeforeFrames(landmark_gain, remaining) ? Verdict::kGoOn
                                                               : TakeStep(remaining);
}

// δ_c and what it leaves to gain; kConverged: that is little, and δ_c may be unknown; kStuck: there
// is no factor.
IncrementalMinimizer::Verdict IncrementalMinimizer::FindStep(EarlierFactor::Verdict earlier,
                                                             double landmark_gain) {
  bool sees_left = earlier == EarlierFactor::Verdict::kStep;
  Status solved;
  if (!sees_left) {
    solved = frame_step_.Factorize();
    sees_left = solved.ok() && frame_step_.SeesLeft(landmark_gain);
  }
  double& remaining = context_.summary->remaining_decrease;
  // Not by the factor of before, which was asked, and saw more than it may leave.
  if (sees_left && earlier != EarlierFactor::Verdict::kStep) {
    context_.control.Sees(remaining);
    if (context_.IsLittleLeft(remaining, landmark_gain)) {
      return Verdict::kConverged;
    }
  }
  // With kStep the factor of before gives the step, and `solved` is still OK.
  solved = solved.ok() ? frame_step_.Solve() : solved;
  if (solved.code == StatusCode::kSingular) {
    return Verdict::kStuck;
  }
  if (!solved.ok()) {
    context_.Finish(Termination::kFailure, solved.message.c_str());
    return Verdict::kFailed;
  }
  if (!sees_left) {
    remaining = frame_step_.AddGain(landmark_gain);
    // Of a system that was not solved to the end all there is to gain is not known.
    const bool is_known = frame_step_.work().converged;
    if (is_known) {
      context_.control.Sees(remaining);
    }
    if (context_.IsLittleLeft(remaining, landmark_gain) && is_known) {
      return Verdict::kConverged;
    }
  }
  return Verdict::kGoOn;
}

IncrementalMinimizer::Verdict IncrementalMinimizer::TakeStep(double remaining) {
  // From here on the step under construction has entries: it is accepted or rejected below.
  SelectActive(remaining);
  bool refreshed = false;
  double gain_ratio = 0.0;
  if (attempts_.Take(&refreshed, &gain_ratio)) {
    NoteDampedSquares();
    attempts_.Accept();
    NoteStep(gain_ratio);
    return Verdict::kGoOn;
  }
  TrialStep& step = context_.system.step();
  step.Reject();
  // Where fresh Jacobians promise so little, and not even that is kept, or the cost does not change
  // at all, there is nothing to be had by more damping. A step that could not be evaluated tells
  // nothing.
  const bool in_vain =
      !refreshed && !context_.control.IsDampedHard() && frame_step_.work().converged &&
      !step.is_cut_off() && IsEvaluated(context_.row()) &&
      context_.stop.IsVain(remaining, context_.row().cost_change, context_.system.cost());
  // The same trust rule as for a claim: aged Jacobians may be why nothing is promised.
  if (!in_vain || context_.relinearization.RefreshAged(context_.Tolerance())) {
    return Retreat(refreshed);
  }
  const double cost = context_.system.cost();
  words_.Say("The last step was refused: it promised %e of the cost, and gained %e.",
             remaining / cost, context_.row().cost_change / cost);
  return Verdict::kConverged;
}

// Little is left by the model: it is believed once its Jacobians are fresh enough and its damping
// is at the floor.
IncrementalMinimizer::Verdict IncrementalMinimizer::ClaimConvergence() {
  // In the order of their cost: Jacobians that may mislead, then μ, which begins the factor of S
  // anew, then landmarks, which are eliminated anew.
  context_.row().refreshed = context_.relinearization.RefreshAged(
      context_.stop.ErrorAllowed(context_.system.cost(), context_.tuning.relinearize.strict_share));
  if (context_.row().refreshed) {
    return Verdict::kGoOn;
  }
  if (context_.control.RelaxOnce(context_.Tolerance())) {
    context_.stop.CountStepsFrom(context_.summary->num_iterations, context_.system.cost());
    return Verdict::kGoOn;
  }
  if (!context_.control.IsDampedHard()) {
    // What the last step tells is cheap, and what the next one does, more to the point.
    const double remaining = LeftBeyondRounding();
    const double little = context_.tuning.stop.rest_share * context_.Tolerance();
    if (linearization_.MayHide(remaining) || context_.control.MayHide(remaining, little)) {
      LookAtStep();
    }
    const bool lowered = context_.control.LowerOnce(remaining, little);
    switch (linearization_.FreeHeldLandmarks(lowered, remaining)) {
      case UpdateLinearization::Freed::kSome:
        return Verdict::kGoOn;
      case UpdateLinearization::Freed::kFailed:
        return Verdict::kFailed;
      default:
        return lowered ? Verdict::kGoOn : Verdict::kConverged;
    }
  }
  // μ was at its floor, steps were refused there, and it has risen again.
  switch (context_.control.JudgeRefusals(context_.Tolerance())) {
    case StepControl::Verdict::kMinimum:
      words_.Say("Steps are refused, and promised no more than the function tolerance.");
      return Verdict::kConverged;
    case StepControl::Verdict::kRefusals:
      context_.summary->rests_on_refusals = true;
      words_.Say("Steps of all lengths are refused, up to a damping of %e.", context_.control.mu());
      return Verdict::kConverged;
    case StepControl::Verdict::kUnknown:
      return Verdict::kStuck;
    // kTryBetween: a damping between the last two was set, and the loop goes on with it.
    default:
      return Verdict::kGoOn;
  }
}

// R, of which weak directions may have many times as much; 0 where it is rounding.
double IncrementalMinimizer::LeftBeyondRounding() const {
  const double remaining = context_.summary->remaining_decrease;
  return context_.stop.IsRounding(remaining, context_.system.cost()) ? 0.0 : remaining;
}

// The whole step that a claim speaks of, of which nothing is taken.
void IncrementalMinimizer::LookAtStep() {
  if (!frame_step_.Solve().ok()) {
    return;
  }
  const FrameStep& step = frame_step_;
  context_.active.Select(step.values(), step.reduced(), step.work().solved,
                         {-1.0, Negligible(), context_.summary->remaining_decrease},
                         &context_.system);
  has_looked_ = true;
  NoteDampedSquares();
  context_.system.step().Reject();
}

// What the damping of landmarks, and that of frames, takes part with. Of a step that was shortened
// it is not known how far the whole one would have gone, nor of one of which a part stays undone.
void IncrementalMinimizer::NoteDampedSquares() {
  if (context_.row().shortened || !context_.active.is_whole()) {
    linearization_.NoteDampedSquare(HUGE_VAL);
    context_.control.NoteDampedSquare(HUGE_VAL);
    return;
  }
  const DampedSquares squares = context_.system.step().FindDampedSquares(
      context_.control.mu(), linearization_.LandmarkDamping());
  linearization_.NoteDampedSquare(squares.more);
  context_.control.NoteDampedSquare(squares.like_frames);
}

// What a row that was not solved anew may leave: after a look all rows were, for a step that was
// not taken.
double IncrementalMinimizer::Negligible() const {
  return has_looked_ ? 0.0 : frame_step_.Wildfire();
}

// What moves. A problem that is new for the most part is far from its minimum, where half a step
// leads elsewhere than a whole one: all of it moves. So it does if the user wants nothing
// truncated, and where a claim waits for the step: of little left nothing would move.
void IncrementalMinimizer::SelectActive(double remaining) {
  UpdateSummary& summary = *context_.summary;
  const StageTimer timer(&summary.select_seconds);
  const double allowed = context_.stop.Allowed(context_.system.cost());
  const double truncation = context_.shares.truncation;
  const bool all = context_.mostly_new || truncation == 0.0 || context_.stop.waits_for_step();
  // B of docs/algorithms.md, "Lazy steps". The second term keeps small steps from being truncated
  // to nothing: that much may be left anyway. A negative budget moves all.
  const double budget =
      all ? -1.0 : std::max(truncation * remaining, context_.tuning.truncate.floor * allowed);
  const FrameStep& step = frame_step_;
  context_.active.Select(step.values(), step.reduced(), step.work().solved,
                         {budget, Negligible(), remaining - landmarks_.Gain()}, &context_.system);
  summary.num_moved_frames += static_cast<int>(context_.active.frames().size());
  summary.num_visited_landmarks += static_cast<int>(context_.active.landmarks().size());
}

// What a step tells of the next: μ by its gain ratio, the stopping rule by its promise, and whether
// the factor of S from before it may be asked. A shortened step, or one that bounds cut off,
// promised something else than what was seen left, so it tells nothing of the series.
void IncrementalMinimizer::NoteStep(double gain_ratio) {
  context_.control.Accept(gain_ratio, context_.row().cost_change, context_.row().shortened);
  const bool shortened = context_.row().shortened || context_.system.step().is_cut_off();
  // The norm of the rest is a pass over all frames.
  if (context_.options.parameter_tolerance > 0.0) {
    tolerances_.NoteStep(shortened ? -1.0
                                   : std::hypot(context_.row().step_norm, frame_step_.Norm()));
  }
  context_.stop.StepTaken(shortened ? 0.0 : context_.summary->remaining_decrease,
                          context_.row().cost_change, gain_ratio);
  // Steps that keep what they promise and promise as much again are kept short by μ.
  if (context_.stop.factor_of_last_step() > context_.tuning.stop.steady_factor &&
      context_.control.IsGood(gain_ratio) && !context_.control.IsDampedHard()) {
    context_.control.LowerOnce(HUGE_VAL, context_.summary->remaining_decrease);
  }
  has_looked_ = false;
  context_.relinearization.Forgive();
  landmarks_.FramesMoved();
  linearization_.ForgetFreed();
  earlier_factor_.NoteStep(gain_ratio, shortened);
}

// Refresh before retreat; then more damping, which the landmarks that would have moved take up too.
IncrementalMinimizer::Verdict IncrementalMinimizer::Retreat(bool refreshed) {
  ++context_.summary->num_unsuccessful_steps;
  UpdateIteration& row = context_.row();
  row.refreshed = refreshed;
  if (refreshed) {
    return Verdict::kGoOn;
  }
  // Where S had no factor there was no step, and what is left is that of another damping.
  const bool tried = row.step == UpdateStep::kFrames;
  // it could not be evaluated, or promised nothing
  const bool blindly = tried && !(row.model_cost_change > 0.0);
  StepControl& control = context_.control;
  const bool may_go_on =
      control.Refuse(tried ? context_.summary->remaining_decrease : HUGE_VAL, blindly);
  // A change of μ does not reach landmarks by itself: λ is that of their elimination.
  for (const std::int32_t landmark : context_.active.landmarks()) {
    if (context_.options.damping == DampingForm::kHybrid &&
        context_.system.schur().blocks().lambda(landmark) < control.mu()) {
      context_.system.Redamp(landmark);
    }
  }
  // Beyond max_damping the Update ends without convergence.
  return may_go_on ? Verdict::kGoOn : Verdict::kStuck;
}

}  // namespace inceres::internal
