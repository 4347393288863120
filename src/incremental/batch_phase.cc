#include "incremental/batch_phase.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "base/stopwatch.h"
#include "incremental/one_time_solve.h"
#include "incremental/stagnation.h"
#include "trust_region/loop_options.h"
#include "trust_region/strategy.h"

namespace inceres::internal {
namespace {

// Steps taken one after another, after which a Dog-Leg's radius is no longer what a refusal has
// made it.
constexpr int kAcceptedInRow = 2;

// What a cost may change by without counting.
double ToleranceAt(double cost, const IncrementalOptions& options) {
  return options.function_tolerance * std::max(cost - options.fixed_cost, 0.0);
}

// What comes after the batch solver: the incremental one, which finishes, or nothing.
enum class BatchEnd { kHandsOver, kToTheEnd };

// Counts the work, writes the trace, and ends the solve when the Update's observer says so, on
// request, when the work budget is spent, and, before one more step proves it, where what is left
// is below the tolerance: good steps gain so fast less, or the next one promises too little.
class BatchObserver final : public SolveObserver, public StepJudge {
 public:
  BatchObserver(const IncrementalOptions& options, const Tuning::Batch& tuning, BatchEnd end,
                const std::atomic<bool>& stop, int num_factors, const double** shown_state,
                UpdateTrace* trace)
      : options_(options),
        tuning_(tuning),
        end_(end),
        stop_(stop),
        num_factors_(num_factors),
        shown_state_(shown_state),
        trace_(*trace),
        stagnation_(tuning) {}
  ~BatchObserver() override { *shown_state_ = nullptr; }
  BatchObserver(const BatchObserver&) = delete;
  BatchObserver& operator=(const BatchObserver&) = delete;

  void BeforeEvaluation(const double* /*state*/, bool jacobians, bool /*new_point*/) override {
    UpdateSummary& summary = trace_.summary();
    if (jacobians) {
      summary.num_relinearized_factors += num_factors_;
    } else {
      summary.num_evaluated_factors += num_factors_;
    }
  }

  bool IsWorthTrying(const IterationSummary& iteration, double cost) override {
    const double promise = iteration.model_cost_change;
    const double factor = promise / last_promise_;
    const double rest = std::max(1.0, last_ratio_) * promise / (1.0 - factor);
    const bool known = last_ratio_ > tuning_.kept_promise && factor < tuning_.steady_factor;
    const bool series = known && !IsByMarquardt() && rest <= tuning_.rest_share * Tolerance(cost);
    const bool nothing = end_ == BatchEnd::kToTheEnd && promise <= Allowed(cost);
    tried_radius_ = iteration.trust_region_radius;
    settled_ = options_.batch_share > 0.0 && SeesEnough() && (series || nothing);
    rest_ = !settled_ ? 0.0 : series ? rest : promise;
    promises_nothing_ = SeesAll() && promise <= Tolerance(cost);
    last_promise_ = promise;
    return !settled_;
  }

  bool IsLast(const IterationSummary& iteration) override {
    last_judged_ = iteration.iteration;
    if (iteration.step_share < 1.0) {  // its gain is what the border left of it
      previous_gain_ = 0.0;
      previous_ratio_ = HUGE_VAL;
      return false;
    }
    settled_ = HasJustSettled(iteration);
    return settled_;
  }

  double RestartRadius() override { return stagnation_.TakeRestartRadius(); }

  double LeastRadius() override {
    return is_near_ && steps_to_wait_ == 0 ? tuning_.seeing_radius : 0.0;
  }

  ObserverAction EndOfIteration(const IterationSummary& iteration,
                                const double* best_state) override {
    if (iteration.step_is_successful) {
      cost_ = iteration.cost;
      best_cost_ = iteration.iteration == last_judged_ ? std::min(best_cost_, cost_) : cost_;
    }
    num_accepted_in_row_ = iteration.step_is_successful ? num_accepted_in_row_ + 1 : 0;
    WaitAfterRefusal(iteration);
    // What landmarks gained by themselves says nothing of the model.
    last_ratio_ = iteration.model_cost_change == last_promise_ ? iteration.relative_decrease : 0.0;
    is_near_ = options_.batch_share > 0.0 && iteration.step_is_successful &&
               last_ratio_ > tuning_.kept_promise &&
               iteration.cost_change <= tuning_.near_gain * Tolerance(cost_);
    if (iteration.step_is_successful &&
        iteration.iteration != last_judged_) {  // the start, or the cost is another function
      stagnation_.Begin(cost_);
    }
    if (iteration.iteration == 0 &&
        !trace_.summary().iterations.empty()) {  // told as the end of the part before
      return stop_.load(std::memory_order_relaxed) ? ObserverAction::kTerminateSuccessfully
                                                   : ObserverAction::kContinue;
    }
    WriteRow(iteration);
    *shown_state_ = best_state;
    const bool go_on = trace_.EndRow(cost_);
    *shown_state_ = nullptr;
    settled_ = settled_ || IsRefusedForNothing(iteration) || HasStagnated(iteration);
    const UpdateSummary& summary = trace_.summary();
    if (!go_on) {
      ended_by_user_ = true;
      return summary.termination == Termination::kUserSuccess
                 ? ObserverAction::kTerminateSuccessfully
                 : ObserverAction::kAbort;
    }
    if (iteration.iteration !=
        last_judged_) {  // the start, a refused step, or one that made the cost another function
      previous_gain_ = 0.0;
      previous_ratio_ = HUGE_VAL;
      last_ratio_ = 0.0;
    }
    const bool enough = settled_ || stop_.load(std::memory_order_relaxed) ||
                        summary.num_evaluated_factors + summary.num_relinearized_factors >=
                            options_.max_factor_evaluations;
    return enough ? ObserverAction::kTerminateSuccessfully : ObserverAction::kContinue;
  }

  bool ended_by_user() const { return ended_by_user_; }
  bool settled() const { return settled_; }
  /// Of the best state, where Ceres reports the lowest cost seen, refused steps included.
  double cost() const { return best_cost_; }
  /// Whether the model, which sees all directions, promises next to nothing: of Ceres's rule, that
  /// the last step would have changed the cost by next to nothing, that is what it means to say.
  bool promises_nothing() const { return promises_nothing_; }
  /// The same of the directions that its damping lets it see.
  bool promises_little() const { return last_promise_ <= Tolerance(cost_); }
  /// Whether a step was refused so lately that a Dog-Leg's radius is still what that has made it.
  bool refused_lately() const { return num_accepted_in_row_ < kAcceptedInRow; }
  /// What the last step and those to come promise, where they are not taken.
  double rest() const { return rest_; }

 private:
  // Hardly damped steps that are refused are tried again after two steps, five, eleven, …
  void WaitAfterRefusal(const IterationSummary& iteration) {
    if (iteration.step_is_successful) {
      steps_to_wait_ = std::max(0, steps_to_wait_ - 1);
    } else if (is_near_ && steps_to_wait_ == 0) {
      steps_to_wait_ = wait_;
      wait_ = 2 * wait_ + 1;
    }
  }
  double Tolerance(double cost) const { return ToleranceAt(cost, options_); }
  bool IsByMarquardt() const {
    return options_.batch_strategy == TrustRegionStrategyKind::kMarquardt;
  }
  // What may be left undone: next to nothing where convergence was slow, for what gains and
  // promises foretell has been wrong there.
  double Allowed(double cost) const {
    return (IsByMarquardt() ? tuning_.proof_share : tuning_.settled_share) * Tolerance(cost);
  }
  // Whether Levenberg–Marquardt's damping is small enough not to hide what weak directions could
  // gain; of a Dog-Leg, whether no refusal has shrunk its radius lately.
  bool SeesAll() const {
    return IsDamped(options_.batch_strategy) ? tried_radius_ >= tuning_.seeing_radius
                                             : !refused_lately();
  }
  // The same, or where steps with so little damping were refused lately, with a bit more.
  bool SeesEnough() const {
    return SeesAll() ||
           (IsByMarquardt() && tried_radius_ >= tuning_.proof_radius && steps_to_wait_ > 0);
  }
  // By Marquardt's rule only: by the others a step is refused for its length alone.
  bool HasStagnated(const IterationSummary& iteration) {
    if (!IsByMarquardt() || options_.batch_share == 0.0 || iteration.iteration == 0) {
      return false;
    }
    const Stagnation::Verdict verdict =
        stagnation_.After(iteration, cost_, Tolerance(cost_), tried_radius_);
    trace_.summary().rests_on_refusals |= verdict == Stagnation::Verdict::kRefusals;
    return verdict != Stagnation::Verdict::kGoOn;
  }
  // A step that was evaluated and refused, but changes next to nothing: there is nothing to be had.
  // (Ceres's rule does not ask whether a step is accepted either.)
  bool IsRefusedForNothing(const IterationSummary& iteration) const {
    return end_ == BatchEnd::kToTheEnd && options_.batch_share > 0.0 && iteration.iteration > 0 &&
           iteration.step_is_valid && !iteration.step_is_successful && SeesAll() &&
           std::fabs(iteration.cost_change) <= tuning_.settled_share * Tolerance(cost_) &&
           iteration.model_cost_change <= Tolerance(cost_);
  }
  bool HasJustSettled(const IterationSummary& iteration) {
    const bool good = iteration.relative_decrease > tuning_.good_model;
    const double gain = good ? iteration.cost_change : 0.0;
    const double allowed = Allowed(iteration.cost);
    // Steps whose gains fall by a ratio r leave gain · r / (1 − r) undone.
    const double ratio = gain / previous_gain_;
    const double slower = std::max(ratio, previous_ratio_);
    const bool fast = ratio < tuning_.fast_ratio && previous_ratio_ < tuning_.fast_ratio;
    // Slow ones are believed where they are all there is, and Ceres's rule would have ended the
    // solve.
    const bool slow =
        end_ == BatchEnd::kToTheEnd && slower < 1.0 && gain <= Tolerance(iteration.cost);
    // What the model was wrong by in this step may still be there: the gradient is off by as much.
    const bool exact = std::fabs(gain - iteration.model_cost_change) <= allowed;
    const bool settled = options_.batch_share > 0.0 && SeesAll() && good && exact && gain >= 0.0 &&
                         (fast || slow) && gain * slower / (1.0 - slower) <= allowed;
    rest_ = settled ? gain * slower / (1.0 - slower) : 0.0;
    previous_gain_ = gain;
    previous_ratio_ = ratio;
    return settled;
  }

  void WriteRow(const IterationSummary& iteration) {
    UpdateIteration& row = trace_.row();
    row.step =
        iteration.iteration > 0 && iteration.step_is_valid ? UpdateStep::kBatch : UpdateStep::kNone;
    row.step_is_successful = iteration.step_is_successful;
    row.cost_change = iteration.cost_change;
    row.model_cost_change = iteration.model_cost_change;
    row.relative_decrease = iteration.relative_decrease;
    row.step_norm = iteration.step_norm;
    row.gradient_max_norm = iteration.gradient_max_norm;
    row.gradient_norm = iteration.gradient_norm;
    row.damping = IsDamped(options_.batch_strategy) ? 1.0 / iteration.trust_region_radius : 0.0;
    row.trust_region_radius = iteration.trust_region_radius;
    row.linear_solver_iterations = iteration.linear_solver_iterations;
    row.step_solver_time_in_seconds = iteration.step_solver_time_in_seconds;
  }

  const IncrementalOptions& options_;
  const Tuning::Batch& tuning_;
  const BatchEnd end_;
  const std::atomic<bool>& stop_;
  const int num_factors_;
  const double** const shown_state_;
  UpdateTrace& trace_;
  double cost_ = 0.0;           // of the state
  double best_cost_ = 0.0;      // of a state there was, since the cost became another function
  double previous_gain_ = 0.0;  // 0, of no use, gives no ratio
  double previous_ratio_ = HUGE_VAL;
  double last_promise_ = HUGE_VAL;
  double tried_radius_ = 0.0;  // of the step under judgment
  double last_ratio_ = 0.0;
  double rest_ = 0.0;
  int last_judged_ = -1;
  bool ended_by_user_ = false;
  int steps_to_wait_ = 0;  // before a step is hardly damped again
  int wait_ = 2;           // after the next refusal of one
  bool is_near_ = false;   // the last step kept its promise, and gained few tolerances
  bool settled_ = false;
  bool promises_nothing_ = false;
  int num_accepted_in_row_ = kAcceptedInRow;
  Stagnation stagnation_;
};

// Whether a trust region that refusals have shrunk may be what kept the last steps short: they then
// tell nothing of what is left. A Dog-Leg's radius says so only while it is the step's length:
// until a step is taken without a refusal before it.
bool IsHeldBack(const Summary& summary, const BatchObserver& observer, const SolverOptions& options,
                const Tuning::Batch& tuning) {
  if (summary.iterations.empty()) {
    return false;
  }
  return IsDamped(options.strategy) ? summary.iterations.back().trust_region_radius <
                                          tuning.shrunk_share * options.initial_trust_region_radius
                                    : observer.refused_lately();
}

// Ceres's rule looks at the last step alone, and does not take it. What it would have gained, and
// steps like it would go on to gain, is left undone.
bool HasSettled(const Summary& summary, const IncrementalOptions& options,
                const Tuning::Batch& tuning) {
  if (summary.termination != Termination::kConvergence) {
    return false;
  }
  double last_gain = 0.0;
  for (const IterationSummary& iteration : summary.iterations) {
    if (iteration.iteration > 0 && iteration.step_is_successful) {
      last_gain = iteration.cost_change;
    }
  }
  const double gain = std::fabs(summary.discarded_cost_change);
  const double allowed = tuning.settled_share * ToleranceAt(summary.final_cost, options);
  return summary.final_cost == 0.0 ||
         (gain < last_gain && gain / (1.0 - gain / last_gain) <= allowed);
}

}  // namespace

bool TakesBatchPhase(const FactorGraph& graph) {
  for (FamilyId family = 0; family < graph.num_families(); ++family) {
    if (graph.NumFreePlaces(family) > 0) {
      return false;
    }
  }
  return graph.num_factors() > 0;
}

namespace {

// What the batch solver is asked for, but for the observer.
SolverOptions BatchOptions(const IncrementalOptions& options, const Tuning::Batch& tuning,
                           BatchEnd end) {
  const bool only = options.batch_share == 0.0;
  SolverOptions batch;
  batch.strategy = options.batch_strategy;
  batch.linear_model = options.batch_linear_model;
  batch.reduced_solver = options.batch_reduced_solver;
  batch.conjugate_gradients = options.batch_conjugate_gradients;
  batch.max_memory_bytes = options.batch_max_memory_bytes;
  batch.reduced_solver_factory = options.reduced_solver_factory;
  batch.num_threads = options.num_threads;
  batch.max_num_iterations = options.max_num_iterations;
  batch.max_solver_time_in_seconds = options.max_solver_time_in_seconds;
  // Down to what may be left: one more iteration here costs less than to linearize everything for
  // the incremental system. Where there will be none the observer says when nothing is left.
  batch.function_tolerance = options.function_tolerance;
  batch.initial_trust_region_radius = 1.0 / options.initial_damping;
  if (!only && options.batch_strategy == TrustRegionStrategyKind::kMarquardt) {
    batch.function_tolerance = 0.0;
    batch.gradient_tolerance = tuning.gradient_tolerance;
    // the observer looks at it
    batch.min_trust_region_radius = std::numeric_limits<double>::min();
    batch.max_trust_region_radius = tuning.max_radius;
    batch.initial_trust_region_radius =
        std::min(batch.initial_trust_region_radius, tuning.max_radius);
  } else if (!only) {
    batch.function_tolerance *=
        end == BatchEnd::kToTheEnd ? tuning.no_gain_share : tuning.settled_share;
  }
  batch.gradient_tolerance = std::max(batch.gradient_tolerance, options.gradient_tolerance);
  batch.parameter_tolerance = options.parameter_tolerance;
  batch.min_relative_decrease = options.min_relative_decrease;
  batch.refine_landmarks = !only && options.max_landmark_refinements > 0;
  batch.reduce_curvature_of_losses = !only;
  return batch;
}

// Adds what one call of the batch solver did to the Update's summary; how it ended is what the last
// one says.
void Count(const Summary& solved, const BatchObserver& observer, UpdateSummary* summary) {
  if (summary->num_batch_iterations == 0) {
    summary->initial_cost = solved.initial_cost;
  }
  summary->remaining_decrease =
      observer.settled() ? observer.rest() : std::fabs(solved.discarded_cost_change);
  const int num_iterations = std::max(0, static_cast<int>(solved.iterations.size()) - 1);
  summary->num_batch_iterations += num_iterations;
  summary->num_iterations += num_iterations;
  summary->num_unsuccessful_steps += solved.num_unsuccessful_steps;
  summary->num_recentered_factors += solved.work.num_recentered_factors;
  if (!solved.reduced_solver.empty()) {
    summary->batch_solver = solved.reduced_solver;
  }
  summary->num_pcg_iterations += static_cast<int>(solved.work.num_conjugate_gradients);
  summary->batch_seconds += solved.seconds.total;
  if (summary->failed_step.empty()) {
    summary->failed_step = solved.failed_step;
  }
  for (double StageSeconds::*stage :
       {&StageSeconds::setup, &StageSeconds::residuals, &StageSeconds::jacobians,
        &StageSeconds::hessian, &StageSeconds::elimination, &StageSeconds::factorization,
        &StageSeconds::back_substitution, &StageSeconds::model_cost, &StageSeconds::total}) {
    summary->batch_stages.*stage += solved.seconds.*stage;
  }
  summary->message = solved.detail.empty() ? solved.message : solved.message + ": " + solved.detail;
}

// One call of the batch solver.
BatchOutcome RunPart(const IncrementalOptions& options, const Tuning::Batch& tuning, BatchEnd end,
                     const std::atomic<bool>& stop, Solver* solver, FactorGraph* graph,
                     const double** shown_state, UpdateTrace* trace) {
  UpdateSummary* summary = &trace->summary();
  summary->rests_on_refusals = false;
  SolverOptions batch = BatchOptions(options, tuning, end);
  BatchObserver observer(options, tuning, end, stop, graph->num_factors(), shown_state, trace);
  batch.observer = &observer;
  LoopOptions loop;
  loop.judge = &observer;
  loop.fixed_cost = options.fixed_cost;
  Summary solved;
  SolveWith(batch, loop, graph, solver, &solved);
  Count(solved, observer, summary);
  const bool cost_of_state = solved.IsSolutionUsable() && !solved.iterations.empty();
  summary->final_cost = cost_of_state ? observer.cost() : solved.final_cost;
  summary->ended_by_batch_rule = false;
  if (!std::isfinite(solved.final_cost)) {  // which Ceres 2.1 takes for convergence
    summary->message = "The cost is not finite.";
    return {Termination::kFailure};
  }
  if (observer.ended_by_user()) {
    return {solved.termination, true};
  }
  if (observer.settled()) {
    summary->message = "What is left undone is below the function tolerance.";
    return {Termination::kConvergence, true};
  }
  if (solved.termination == Termination::kUserSuccess ||
      solved.termination == Termination::kNoConvergence) {
    summary->message = "Stopped by a limit or by request; the state is the best so far.";
    return {Termination::kNoConvergence, true};
  }
  summary->ended_by_batch_rule = solved.termination == Termination::kConvergence;
  const bool held_back = IsHeldBack(solved, observer, batch, tuning);
  const bool no_gradient = solved.iterations.empty() ||
                           solved.iterations.back().gradient_max_norm <= batch.gradient_tolerance;
  const bool settled = observer.promises_little() && HasSettled(solved, options, tuning);
  return {solved.termination, !held_back && settled, held_back,
          observer.promises_nothing() || no_gradient};
}

// A solve from beginning to end. What the user's strategy does not bring to an end within a while,
// or ends with its trust region shrunk by refusals, where its last steps prove nothing, is gone on
// with by Marquardt's rule.
BatchOutcome RunToTheEnd(const IncrementalOptions& options, const Tuning::Batch& tuning,
                         const std::atomic<bool>& stop, Solver* solver, FactorGraph* graph,
                         const double** shown_state, UpdateTrace* trace) {
  UpdateSummary* summary = &trace->summary();
  const bool in_parts =
      options.batch_share > 0.0 && options.batch_strategy != TrustRegionStrategyKind::kMarquardt;
  IncrementalOptions part = options;
  part.max_num_iterations =
      in_parts ? std::min(options.max_num_iterations, tuning.patience) : options.max_num_iterations;
  const BatchOutcome first =
      RunPart(part, tuning, BatchEnd::kToTheEnd, stop, solver, graph, shown_state, trace);
  const bool out_of_patience = first.termination == Termination::kNoConvergence &&
                               summary->num_iterations >= part.max_num_iterations;
  const double seconds_left =
      options.max_solver_time_in_seconds - (NowInSeconds() - trace->start_seconds());
  part.max_num_iterations = options.max_num_iterations - summary->num_iterations;
  const bool proven = !first.held_back &&
                      (summary->ended_by_batch_rule ? first.promises_nothing : !out_of_patience);
  if (!in_parts || proven || first.termination == Termination::kFailure ||
      part.max_num_iterations <= 0 || seconds_left <= 0.0) {
    return first;
  }
  part.max_solver_time_in_seconds = seconds_left;
  if (IsDamped(part.batch_strategy) && !first.held_back) {
    part.initial_damping = std::min(part.initial_damping, summary->iterations.back().damping);
  }
  part.batch_strategy = TrustRegionStrategyKind::kMarquardt;
  const std::vector<double> reached = graph->state();
  const UpdateSummary before = *summary;
  BatchOutcome second =
      RunPart(part, tuning, BatchEnd::kToTheEnd, stop, solver, graph, shown_state, trace);
  if (second.termination == Termination::kFailure) {  // what the first part has reached stays
    graph->mutable_state() = reached;
    summary->message = before.message;
    summary->final_cost = before.final_cost;
    summary->remaining_decrease = before.remaining_decrease;
    summary->ended_by_batch_rule = before.ended_by_batch_rule;
    summary->rests_on_refusals = false;
    return first;
  }
  return second;
}

}  // namespace

BatchOutcome RunBatchPhase(const IncrementalOptions& options, const Tuning::Batch& tuning,
                           const std::atomic<bool>& stop, FactorGraph* graph,
                           const double** shown_state, UpdateTrace* trace) {
  Solver solver(/*max_bytes=*/0);
  return RunPart(options, tuning, BatchEnd::kHandsOver, stop, &solver, graph, shown_state, trace);
}

SolverOptions OneTimeOptions(const IncrementalOptions& options) {
  return BatchOptions(options, TuningOfNewSolvers().batch, BatchEnd::kToTheEnd);
}

void SolveOnce(const IncrementalOptions& options, Solver* solver, FactorGraph* graph,
               UpdateSummary* summary, UpdateObserver* observer, const double** best_state) {
  const std::atomic<bool> stop{false};
  const double* unseen = nullptr;
  *summary = UpdateSummary();
  UpdateTrace trace(observer, summary);
  const Status valid = options.Validate();
  if (valid.ok()) {
    const double** shown = best_state != nullptr ? best_state : &unseen;
    const std::vector<double> start = observer != nullptr ? graph->state() : std::vector<double>();
    summary->termination =
        RunToTheEnd(options, TuningOfNewSolvers().batch, stop, solver, graph, shown, &trace)
            .termination;
    if (summary->termination == Termination::kUserFailure) {
      graph->mutable_state() = start;  // the first part of two may have moved it
    }
  } else {
    summary->message = valid.message;
  }
  if (summary->termination == Termination::kUserFailure ||
      summary->termination == Termination::kFailure) {
    summary->final_cost = summary->initial_cost;  // the graph is where it was
  }
  summary->seconds = NowInSeconds() - trace.start_seconds();
}

}  // namespace inceres::internal
