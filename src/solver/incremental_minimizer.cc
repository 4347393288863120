#include "solver/incremental_minimizer.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "base/stopwatch.h"
#include "linear/select_live_solver.h"

namespace inceres::internal {
namespace {

constexpr double kExact = 1e-20;       // squared error above which a Jacobian is not simply the current one
constexpr double kRefreshShare = 0.1;  // of the thresholds of an old linearisation: what convergence may rest on
constexpr double kWeightChange = 2.0;  // factor by which ρ' may have changed before a factor's weight in H is renewed
// The same where H has half the curvature already: a step may not meet less than a quarter of it.
constexpr double kCorrectedWeightChange = 1.4;
constexpr double kRetreat = 10.0;    // times ν: growth of μ when a step is refused; from its floor doubling would take long
constexpr double kGoodRatio = 0.25;  // gain ratio below which the radius falls
constexpr double kGrowRatio = 0.75;  // gain ratio above which the radius grows
constexpr double kShortening = 0.1;  // of the step, when it is tried again
constexpr int kMaxShortenings = 1;

// Of a landmark, relative: without it a far point, which parallax hardly holds, runs away along its ray and never comes back.
constexpr double kMinLandmarkDamping = 1e-6;

// A landmark is eliminated anew when its damping exceeds that of today by more than this factor.
constexpr double kOutdatedDamping = 100.0;

// Convergence is claimed with μ up to this multiple of its floor only: what is left in weak directions is hidden by more.
constexpr double kNearFloor = 100.0;

// Iterations that together are to bring more than the tolerance.
constexpr int kStagnation = 10;

// Two dampings that differ by less than this factor are as good as the same.
constexpr double kFineDamping = 3.0;

// So many shortened steps in a row, and the radius is given up: more damping then finds a better direction.
constexpr int kMaxShortenedInRow = 3;

// A cost that changes by no more than this, relative, is the same but for rounding.
constexpr double kUnmoved = 1e-15;

// A refused step is laid to the old Jacobians of the factor whose cost rose furthest above its prediction, and of those that come
// up to this share of it.
constexpr double kBlameShare = 0.1;

// Weight of the gradient's error against that of the model in relinearisation_share.
constexpr double kGradientShare = 10.0;

// An Update ends when the model sees less than this share of the tolerance left: with a robust loss the model undervalues what is
// left (its Hessian takes ρ'' down to half the curvature, and of steady factors only), by a factor of 1.2 to 2 on our data.
constexpr double kStopShare = 0.08;

// It also ends when the steps so far let expect that all to come together gain less than this share of it; promises have to fall
// by more than the factor, from one step to the next.
constexpr double kRestShare = 0.5;
constexpr double kSteadyFactor = 0.5;
constexpr double kCreepingLandmarks = 4.0;

// Landmarks step by themselves while together they could gain more than this share of what an Update may leave undone, those of
// them that exceed this share of the mean.
constexpr double kLandmarkShare = 0.3;

// They do so when they hold more than this share of all that is undone.
constexpr double kLandmarkDominance = 0.5;

// Less than this share of what an Update may leave undone is always left.
constexpr double kTruncationFloor = 0.1;

// To this share of what an Update may leave undone, sums that are kept by difference are exact.
constexpr double kSumShare = 1e-3;

// A row of S is solved anew when its change is worth this share of what a frame may leave undone.
constexpr double kWildfireShare = 0.5;

RebuildRule RuleOf(RebuildPolicy policy) {
  return policy == RebuildPolicy::kAlways  ? RebuildRule::kAlways
         : policy == RebuildPolicy::kNever ? RebuildRule::kNever
                                           : RebuildRule::kWhenCheaper;
}

LiveReducedSolverKind KindOf(IncrementalReducedSolver solver) {
  switch (solver) {
    case IncrementalReducedSolver::kAutomatic:
      return LiveReducedSolverKind::kAutomatic;
    case IncrementalReducedSolver::kResumed:
      return LiveReducedSolverKind::kResumed;
    case IncrementalReducedSolver::kDense:
      return LiveReducedSolverKind::kDense;
    case IncrementalReducedSolver::kSparse:
      return LiveReducedSolverKind::kSparse;
    case IncrementalReducedSolver::kPcg:
      return LiveReducedSolverKind::kPcg;
  }
  return LiveReducedSolverKind::kAutomatic;
}

int FirstOf(const std::vector<std::int32_t>& ascending_rows, const LiveSchur& schur) {
  return ascending_rows.empty() ? schur.S().num_rows() : ascending_rows.front();
}

}  // namespace

IncrementalMinimizer::IncrementalMinimizer(const IncrementalOptions& options, LiveSystem* system)
    : options_(options),
      system_(*system),
      solver_(MakeLiveReducedSolver(KindOf(options.reduced_solver), options.reduced_solver_factory, PcgOptions(),
                                    system->executor())),
      mu_(options.initial_damping) {
}

// How far an old linearisation may err before it is renewed, if every factor erred by as much. Its error e = ‖f − f̂‖ counts
// twice: the model is off by w e², and the gradient by what the residual f makes of the old Jacobian, about w ‖f‖ e over the next
// step. The first adds up over the factors, the second, of either sign, like a random walk.
IncrementalMinimizer::ErrorLimits IncrementalMinimizer::LimitsOf(double share) const {
  const double count = std::max(1, system_.num_factors());
  const double gradient = kGradientShare * share * Tolerance();
  return {share * 2.0 * Tolerance() / count, gradient * gradient / count};
}

void IncrementalMinimizer::Minimize(bool mostly_new, const std::atomic<bool>& stop, UpdateTrace* trace) {
  trace_ = trace;
  summary_ = &trace->summary();
  mu_ = std::clamp(mu_, options_.min_damping, options_.initial_damping);
  nu_ = 2.0;
  shares_ = SharesOf(options_, system_.schur().num_landmarks());
  active_.Clear();
  radius_ = HUGE_VAL;
  num_landmark_passes_ = 0;
  frames_moved_ = false;  // the frames first
  mostly_new_ = mostly_new;
  last_promise_ = 0.0;
  landmark_creep_ = 1.0;
  blamed_few_ = false;
  relaxed_ = false;
  undone_at_floor_ = refused_undone_ = HUGE_VAL;
  refused_mu_ = options_.min_damping;
  refused_blindly_ = false;
  num_shortened_ = 0;
  const bool begins = summary_->iterations.empty();  // or the batch solver has told of the start
  const bool new_frames_first = TakesNewFrameSteps();
  if (!(new_frames_first ? LineariseDirty() : Relinearise())) {
    return;
  }
  rounding_ = system_.RoundingOfCost();
  checked_iteration_ = summary_->num_iterations;
  checked_cost_ = system_.cost();
  if (begins) {
    summary_->initial_cost = system_.cost();
  }
  bool go_on = !begins || EndIteration();
  if (go_on && new_frames_first) {
    go_on = StepNewFrames(stop) && Relinearise();
  }
  for (; go_on; go_on = EndIteration()) {
    if (OutOfBudget(stop)) {
      return Finish(Termination::kNoConvergence, "Stopped by a limit or by request; the state is the best so far.");
    }
    const Verdict verdict = Iterate();
    if (verdict == Verdict::kFailed) {
      return;  // with the reason in the summary
    }
    if (verdict == Verdict::kConverged) {
      return Finish(Termination::kConvergence, "What is left undone is below the function tolerance.");
    }
    if (verdict == Verdict::kStuck) {
      if (EndIteration()) {
        Finish(Termination::kNoConvergence, "Steps are refused until damping leaves nothing to gain.");
      }
      return;
    }
    if (!Relinearise()) {
      return;
    }
  }
}

void IncrementalMinimizer::Finish(Termination termination, const char* message) {
  summary_->termination = termination;
  summary_->message = message;
}

// False if the observer ends the Update.
bool IncrementalMinimizer::EndIteration() {
  UpdateIteration& row = trace_->row();
  row.damping = mu_;
  row.radius = radius_;
  if (trace_->observed()) {
    system_.schur().RhsNorms(&row.gradient_max_norm, &row.gradient_norm);
  }
  return trace_->EndRow(system_.cost());
}

bool IncrementalMinimizer::OutOfBudget(const std::atomic<bool>& stop) const {
  return summary_->num_iterations >= options_.max_num_iterations || stop.load(std::memory_order_relaxed) ||
         summary_->num_evaluated_factors + summary_->num_relinearised_factors >= options_.max_factor_evaluations ||
         NowInSeconds() - trace_->start_seconds() >= options_.max_seconds;
}

double IncrementalMinimizer::LandmarkDamping() const {
  return options_.damping == DampingForm::kThesis ? 0.0 : std::max(mu_, kMinLandmarkDamping);
}

// Cost changes below this do not count: the user's tolerance, and where the cost is next to zero the rounding of the residuals.
double IncrementalMinimizer::Tolerance() const {
  return std::max(options_.function_tolerance * system_.cost(), rounding_ / kStopShare);
}

bool IncrementalMinimizer::Relinearise() {
  const StageTimer timer(&summary_->linearise_seconds);
  system_.RedampAbove(kOutdatedDamping * LandmarkDamping());
  RelineariseWork work;
  return Count(system_.Relinearise(LandmarkDamping(), RuleOf(options_.rebuild), &work), work);
}

bool IncrementalMinimizer::LineariseDirty() {
  const StageTimer timer(&summary_->linearise_seconds);
  RelineariseWork work;
  return Count(system_.LineariseDirty(&work), work);
}

// False if the linearisation failed.
bool IncrementalMinimizer::Count(const Status& status, const RelineariseWork& work) {
  summary_->num_relinearised_factors += work.num_factors;
  summary_->num_recentred_factors += work.num_recentred;
  summary_->num_eliminated_landmarks += work.num_landmarks;
  summary_->num_rebuilds += work.rebuilt ? 1 : 0;
  summary_->num_drifted_frames += work.num_drifted_frames;
  if (!status.ok()) {
    Finish(Termination::kFailure, status.message.c_str());
  }
  return status.ok();
}

// Landmarks that could still gain much by themselves, most of them outliers that a robust loss lets converge slowly, go ahead
// without the frames: a pass costs their own factors only. True if any moved.
bool IncrementalMinimizer::StepLandmarks() {
  LiveSchur& schur = system_.schur();
  const double gain = LandmarkGain();
  if (num_landmark_passes_ <= 0 || gain <= kLandmarkShare * kStopShare * Tolerance()) {
    return false;
  }
  --num_landmark_passes_;
  const StageTimer timer(&summary_->landmark_seconds);
  const double cost = system_.cost();
  int num_evaluated = 0;
  const bool moved =
      system_.StepLandmarks(schur.EagerLandmarks(kLandmarkShare * gain / std::max(1, schur.num_landmarks())), &num_evaluated);
  ++summary_->num_landmark_passes;
  summary_->num_evaluated_factors += num_evaluated;
  if (moved) {
    UpdateIteration& row = trace_->row();
    row.step = UpdateStep::kLandmarks;
    row.accepted = true;
    row.cost_change = cost - system_.cost();
    landmark_creep_ = std::max(1.0, row.cost_change / gain);
    row.step_norm = system_.StepNorm();
    MarkStale();
    system_.EndStep();
  }
  return moved;
}

IncrementalMinimizer::Verdict IncrementalMinimizer::Iterate() {
  if (StepLandmarks()) {
    return Verdict::kGoOn;
  }
  ++summary_->num_iterations;
  const Status solved = SolveFrames();
  if (solved.code == StatusCode::kSingular) {
    return Retreat(false);
  }
  if (!solved.ok()) {
    Finish(Termination::kFailure, solved.message.c_str());
    return Verdict::kFailed;
  }
  const double undone = Undone();
  summary_->undone = undone;
  undone_at_floor_ = IsDampedHard() ? undone_at_floor_ : undone;
  // The stopping rule: little is left, now or in all steps to come, or nothing has come for long; and that is to be trusted.
  const bool little_left = undone + (landmark_creep_ - 1.0) * LandmarkGain() <= kStopShare * Tolerance() ||
                           NextStepsGainLittle(undone) || (HasStagnated() && undone <= Tolerance());
  if (little_left && solver_->work().converged) {  // a solve that was cut short does not know all there is to gain
    // Refresh before success.
    trace_->row().refreshed = RefreshAged();
    if (trace_->row().refreshed || RelaxDamping()) {
      return Verdict::kGoOn;
    }
    return IsDampedHard() ? JudgeRefusals() : Verdict::kConverged;
  }
  if (frames_moved_ && !mostly_new_ && LandmarkGain() > kLandmarkDominance * undone) {
    frames_moved_ = false;
    num_landmark_passes_ = options_.max_landmark_passes;
    if (StepLandmarks()) {
      return Verdict::kGoOn;
    }
  }
  {
    const StageTimer timer(&summary_->select_seconds);
    active_.Select(frame_step_, reduced_, solver_->work().solved, {TruncationBudget(undone), Wildfire(), undone - LandmarkGain()},
                   &system_);
    summary_->num_moved_frames += static_cast<int>(active_.frames().size());
    summary_->num_visited_landmarks += static_cast<int>(active_.landmarks().size());
  }
  bool refreshed = false;
  if (TakeStep(&refreshed)) {
    return Verdict::kGoOn;
  }
  system_.Reject();
  // Where fresh Jacobians promise so little, and not even that is kept, or the cost does not change at all, there is nothing to
  // be had by more damping.
  const bool unmoved = std::fabs(trace_->row().cost_change) <= kUnmoved * system_.cost();
  const bool in_vain =
      !refreshed && !IsDampedHard() && solver_->work().converged && (unmoved || undone <= kRestShare * Tolerance());
  return in_vain && !RefreshAged() ? Verdict::kConverged : Retreat(refreshed);
}

// Damping hides what weak directions could gain: before success it goes to its floor. Once only while no step is taken there, for
// where steps are refused it grows again. True if it was lowered.
bool IncrementalMinimizer::RelaxDamping() {
  if (!IsDampedHard() || relaxed_) {
    return false;
  }
  relaxed_ = true;
  mu_ = options_.min_damping;
  nu_ = 2.0;
  return true;
}

// Steps were refused, up to the damping at which nothing is left to gain. If they were evaluated that is the minimum, as far as
// steps between the last two dampings could not gain much either; of what a cost function refused to evaluate nothing is known.
IncrementalMinimizer::Verdict IncrementalMinimizer::JudgeRefusals() {
  if (refused_blindly_) {
    return Verdict::kStuck;
  }
  if (std::min(undone_at_floor_, refused_undone_) <= Tolerance() || mu_ <= kFineDamping * refused_mu_) {
    return Verdict::kConverged;
  }
  mu_ = std::sqrt(mu_ * refused_mu_);
  return Verdict::kGoOn;
}

bool IncrementalMinimizer::IsDampedHard() const {
  return mu_ > kNearFloor * options_.min_damping;
}

// Whether the last so many iterations have brought less than the tolerance together.
bool IncrementalMinimizer::HasStagnated() {
  if (summary_->num_iterations < checked_iteration_ + kStagnation) {
    return false;
  }
  const bool stagnated = checked_cost_ - system_.cost() <= Tolerance();
  if (!stagnated) {
    checked_iteration_ = summary_->num_iterations;
    checked_cost_ = system_.cost();
  }
  return stagnated;
}

// Steps tell how much their model undervalues: the last gained `last_gain_ratio_` times what it promised, and what is promised
// has fallen by a factor since. Steps like that go on to gain the sum of a geometric series. Landmarks that creep are counted
// more than once.
bool IncrementalMinimizer::NextStepsGainLittle(double undone) {
  if (!(last_promise_ > 0.0) || mostly_new_) {
    return false;
  }
  const double factor = undone / last_promise_;
  const double landmarks = std::max(kCreepingLandmarks, landmark_creep_) * LandmarkGain();
  return factor < kSteadyFactor &&
         std::max(1.0, last_gain_ratio_) * undone / (1.0 - factor) + landmarks <= kRestShare * Tolerance();
}

// What a step may leave undone. A problem that is new for the most part is far from its minimum, where half a step leads
// elsewhere than a whole one: all of it moves. So it does if the user wants nothing truncated.
double IncrementalMinimizer::TruncationBudget(double undone) const {
  if (mostly_new_ || shares_.truncation == 0.0) {
    return -1.0;
  }
  return std::max(shares_.truncation * undone, kTruncationFloor * kStopShare * Tolerance());
}

// Tries the step, within the trust region once there is one. A step that is refused with no old Jacobian to blame is tried
// again along the dog-leg path: that costs an evaluation, where more damping costs a factorisation too.
bool IncrementalMinimizer::TakeStep(bool* refreshed) {
  double norm = -1.0;  // looked for when it is needed: mostly the radius is infinite
  if (radius_ < HUGE_VAL) {
    norm = system_.ScaledStepNorm();
    if (norm > radius_) {
      norm = radius_;
      system_.ShortenStep(norm);
      trace_->row().shortened = true;
    }
  }
  for (int attempt = 0;; ++attempt) {
    double ratio = 0.0;
    const bool accepted = EvaluateStep(&ratio) && ratio > options_.min_relative_decrease;
    if (norm < 0.0 && !(accepted && ratio > kGrowRatio)) {
      norm = system_.ScaledStepNorm();
    }
    if (accepted) {
      if (ratio > kGrowRatio) {
        radius_ = std::max(radius_, 3.0 * norm);
      } else if (ratio < kGoodRatio) {
        radius_ = 0.5 * norm;
      }
      Accept(ratio);
      return true;
    }
    *refreshed = RefreshTouched();
    if (*refreshed || attempt >= kMaxShortenings) {
      radius_ = HUGE_VAL;  // the damping takes over
      return false;
    }
    ++summary_->num_shortened_steps;
    trace_->row().shortened = true;
    norm *= kShortening;
    radius_ = norm;
    system_.ShortenStep(norm);
  }
}

// δ_c from (S + μ diag(C)) δ_c = b. kSingular if there is no factor.
Status IncrementalMinimizer::SolveFrames() {
  const StageTimer timer(&summary_->solve_seconds);
  LiveSchur& schur = system_.schur();
  damped_anew_ |= reduced_.Refresh(options_.damping, mu_, &schur);
  frame_step_.resize(schur.size(), 0.0);
  schur.TakeUnfactoredRows(&changed_rows_);
  LiveReducedSolver::Change change(FirstOf(changed_rows_, schur), &changed_rows_, true);
  if (std::exchange(damped_anew_, false)) {
    change = LiveReducedSolver::Change();  // of everything
  }
  const Status factored = solver_->Factorize(schur.S(), reduced_.damping().data(), reduced_.held().data(), change);
  summary_->num_factored_rows += solver_->work().factored_rows;
  summary_->num_reorderings += solver_->work().reorderings;
  if (!factored.ok()) {
    return factored;
  }
  LiveReducedSolver::Truncation truncation;
  truncation.weights = reduced_.weights().data();
  truncation.threshold = Wildfire();
  schur.TakeUnsolvedRows(&changed_rows_);
  const LiveReducedSolver::Rows changed_b{FirstOf(changed_rows_, schur), &changed_rows_};
  Status solved = solver_->Solve(reduced_.b().data(), changed_b, truncation, frame_step_.data());
  summary_->num_solved_rows += solver_->work().solved_rows;
  summary_->num_pcg_iterations += solver_->work().iterations;
  trace_->row().num_linear_solver_iterations = std::max(1, solver_->work().iterations);
  return solved;
}

double IncrementalMinimizer::Wildfire() const {
  return kWildfireShare * Tolerance() / std::max(1, system_.schur().num_frames());
}

// What the landmarks could gain by themselves.
double IncrementalMinimizer::LandmarkGain() {
  return system_.schur().TotalDecrement(kSumShare * kStopShare * Tolerance());
}

// What the model promises for the whole step, all of it still undone.
double IncrementalMinimizer::Undone() {
  double sum = LandmarkGain();
  for (std::size_t k = 0; k < frame_step_.size(); ++k) {
    sum += 0.5 * reduced_.b()[k] * frame_step_[k];
  }
  return sum;
}

bool IncrementalMinimizer::EvaluateStep(double* gain_ratio) {
  const StageTimer timer(&summary_->evaluate_seconds);
  double change = 0.0;
  double predicted = 0.0;
  const Status status = system_.EvaluateStep(&change, &predicted);
  const bool evaluated = status.ok();
  if (!evaluated && summary_->failed_step.empty()) {
    summary_->failed_step = status.message;
  }
  for (const LiveFamily& family : system_.families()) {
    summary_->num_evaluated_factors += static_cast<std::int64_t>(system_.Touched(family.id()).size());
  }
  *gain_ratio = evaluated && predicted > 0.0 ? -change / predicted : -1.0;
  UpdateIteration& row = trace_->row();
  row.step = UpdateStep::kFrames;
  row.step_norm = system_.StepNorm();
  row.cost_change = evaluated ? -change : -std::numeric_limits<double>::max();
  row.predicted_change = evaluated ? predicted : 0.0;
  row.relative_decrease = evaluated ? *gain_ratio : std::numeric_limits<double>::lowest();
  return evaluated;
}

// The step moves the state, and what it touched is looked at.
void IncrementalMinimizer::AcceptStep() {
  const StageTimer timer(&summary_->accept_seconds);
  trace_->row().accepted = true;
  summary_->num_updated_landmarks += system_.AcceptValues();
  MarkStale();
  TakeStepOff();
  system_.EndStep();
}

void IncrementalMinimizer::Accept(double gain_ratio) {
  AcceptStep();
  num_shortened_ = trace_->row().shortened ? num_shortened_ + 1 : 0;
  if (num_shortened_ >= kMaxShortenedInRow && gain_ratio <= kGrowRatio) {
    radius_ = HUGE_VAL;
    mu_ *= kRetreat;
    num_shortened_ = 0;
  }
  mu_ = std::max(options_.min_damping, mu_ * std::max(1.0 / 3.0, 1.0 - std::pow(2.0 * gain_ratio - 1.0, 3)));
  nu_ = 2.0;
  relaxed_ = relaxed_ && IsDampedHard();
  refused_blindly_ = refused_blindly_ && IsDampedHard();
  refused_undone_ = IsDampedHard() ? refused_undone_ : HUGE_VAL;
  frames_moved_ = true;
  blamed_few_ = false;
  last_promise_ = trace_->row().shortened ? 0.0 : summary_->undone;
  last_gain_ratio_ = gain_ratio;
}

// What was applied is no longer part of the step still to take.
void IncrementalMinimizer::TakeStepOff() {
  LiveSchur& schur = system_.schur();
  for (const std::int32_t frame : active_.frames()) {
    const double* applied = system_.FrameStep(frame);
    double* step = frame_step_.data() + schur.FrameOffset(frame);
    for (int k = 0; k < schur.frames()[frame].size; ++k) {
      step[k] -= applied[k];
    }
    schur.TouchB(frame);
  }
}

// Marks for relinearisation the touched factors whose old linearisation errs too much, or whose weight has changed.
void IncrementalMinimizer::MarkStale() {
  const ErrorLimits stale = LimitsOf(shares_.relinearisation);
  const ErrorLimits aged = LimitsOf(std::min(shares_.relinearisation, kRefreshShare));
  aged_.resize(system_.families().size());
  for (const LiveFamily& family : system_.families()) {
    aged_[family.id()].Grow(family.num_places());
    for (const std::int32_t i : system_.Touched(family.id())) {
      const bool errs = options_.relinearisation == RelinearisationRule::kStepSize && !family.constant_jacobian()
                            ? system_.LargestStep({family.id(), i}) >= options_.relinearisation_step
                            : stale.ExceededBy(family, i);
      if (errs || family.WeightIsOff(i, family.IsCorrected(i) ? kCorrectedWeightChange : kWeightChange)) {
        system_.MarkDirty({family.id(), i});
      } else if (aged.ExceededBy(family, i)) {
        aged_[family.id()].Add(i);
      }
    }
  }
}

// Marks every factor whose old linearisation is not good enough to claim convergence on. True if there are any.
bool IncrementalMinimizer::RefreshAged() {
  const ErrorLimits limits = LimitsOf(std::min(shares_.relinearisation, kRefreshShare));
  bool any = false;
  for (std::size_t family = 0; family < aged_.size(); ++family) {
    const LiveFamily& factors = system_.families()[family];
    aged_[family].ForEach([&](std::int32_t i) {
      if (factors.linearised(i) && limits.ExceededBy(factors, i)) {
        system_.MarkDirty({factors.id(), i});
        any = true;
      }
    });
    aged_[family].Clear();
  }
  return any;
}

// The step failed: with old Jacobians about it was perhaps their fault. True if any are marked: those whose factors' costs rose
// furthest above what was predicted of them, and all if the step before failed like this.
bool IncrementalMinimizer::RefreshTouched() {
  const auto for_each_old = [this](auto&& visit) {
    for (const LiveFamily& family : system_.families()) {
      for (const std::int32_t i : system_.Touched(family.id())) {
        if (family.SquaredError(i) > kExact) {
          visit(FactorRef{family.id(), i});
        }
      }
    }
  };
  const auto unforeseen = [this](FactorRef ref) { return system_.families()[ref.family].UnforeseenCost(ref.factor); };
  const bool evaluated = trace_->row().predicted_change > 0.0;
  const bool all = std::exchange(blamed_few_, true) || !evaluated;
  double worst = 0.0;
  if (!all) {
    for_each_old([&](FactorRef factor) { worst = std::max(worst, unforeseen(factor)); });
  }
  // Written so that a cost that is not finite is to blame.
  const double blameless = std::min(kBlameShare * worst, std::numeric_limits<double>::max());
  bool any = false;
  for_each_old([&](FactorRef factor) {
    if (all || !(unforeseen(factor) <= blameless)) {
      system_.MarkDirty(factor);
      any = true;
    }
  });
  return any;
}

// Refresh before retreat; then more damping, which the landmarks that would have moved take up too.
IncrementalMinimizer::Verdict IncrementalMinimizer::Retreat(bool refreshed) {
  ++summary_->num_rejected_steps;
  trace_->row().refreshed = refreshed;
  if (refreshed) {
    return Verdict::kGoOn;
  }
  refused_mu_ = mu_;
  refused_undone_ = summary_->undone;
  refused_blindly_ |= trace_->row().step == UpdateStep::kFrames && !std::isfinite(trace_->row().relative_decrease);
  mu_ *= kRetreat * nu_;
  nu_ *= 2.0;
  for (const std::int32_t landmark : active_.landmarks()) {
    if (options_.damping == DampingForm::kHybrid && system_.schur().landmarks()[landmark].lambda < mu_) {
      system_.Redamp(landmark);
    }
  }
  return mu_ > options_.max_damping ? Verdict::kStuck : Verdict::kGoOn;
}

}  // namespace inceres::internal
