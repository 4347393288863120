#include "incremental/batch_phase.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "incremental/claim_in_words.h"

namespace inceres::internal {

// The batch solver's part of an Update, and the whole of a one-time solve (docs/algorithms.md,
// "One-time solves and exact windows"). It works on the graph's state and keeps nothing for the
// next call. Its function tolerance is set so low that BatchObserver mostly ends the solve first,
// by the fall of its gains; what Ceres's rules end instead is judged here once more, because they
// look at the last step alone.
//
// Nothing here decides by time but the solver's own limit. A failure leaves the state as it was,
// which is the batch solver's contract.

namespace {

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
  // The gain of the last step that was taken, against that of the one that was proposed and not
  // taken: their ratio is that of the series.
  double last_gain = 0.0;
  for (const IterationSummary& iteration : summary.iterations) {
    if (iteration.iteration > 0 && iteration.step_is_successful) {
      last_gain = iteration.cost_change;
    }
  }
  const double gain = std::fabs(summary.discarded_cost_change);
  // With r = gain / last_gain all that is left, the step not taken included, is gain / (1 − r).
  const double allowed = tuning.settled_share * ToleranceAt(summary.final_cost, options);
  return summary.final_cost == 0.0 ||
         (gain < last_gain && gain / (1.0 - gain / last_gain) <= allowed);
}

// Adds what one call of the batch solver did to the Update's summary; how it ended is what the last
// one says.
void Count(const Summary& solved, const BatchObserver& observer, UpdateSummary* summary) {
  // Of two parts the first one knows where the solve began.
  if (summary->num_batch_iterations == 0) {
    summary->initial_cost = solved.initial_cost;
  }
  // Without a step that was proposed and not taken nothing is known of what is left.
  summary->remaining_decrease = observer.settled() ? observer.rest()
                                : solved.discarded_cost_change != 0.0
                                    ? std::fabs(solved.discarded_cost_change)
                                    : -1.0;
  // Iteration 0 is the start and no step.
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
  // The first refused step is told, of all parts.
  if (summary->failed_step.empty()) {
    summary->failed_step = solved.failed_step;
  }
  // Stages of all parts add up, as the counts do.
  for (double StageSeconds::*stage :
       {&StageSeconds::setup, &StageSeconds::residuals, &StageSeconds::jacobians,
        &StageSeconds::hessian, &StageSeconds::elimination, &StageSeconds::factorization,
        &StageSeconds::back_substitution, &StageSeconds::model_cost, &StageSeconds::total}) {
    summary->batch_stages.*stage += solved.seconds.*stage;
  }
  summary->message = solved.detail.empty() ? solved.message : solved.message + ": " + solved.detail;
}

}  // namespace

// Numbers of factors are places there, and a free place has no factor to evaluate.
bool TakesBatchPhase(const FactorGraph& graph) {
  for (FamilyId family = 0; family < graph.num_families(); ++family) {
    if (graph.NumFreePlaces(family) > 0) {
      return false;
    }
  }
  return graph.num_factors() > 0;
}

SolverOptions BatchOptions(const IncrementalOptions& options, const Tuning::Batch& tuning,
                           BatchEnd end) {
  // Without an incremental part the options are what inceres::Solve has: its trace is to be the
  // same.
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
  // The radius of Levenberg–Marquardt is one over its damping.
  batch.initial_trust_region_radius = 1.0 / options.initial_damping;
  // Marquardt's rule goes on where others have given up; all its ends but the gradient's are the
  // observer's, which sees stagnation and refusals.
  if (!only && options.batch_strategy == TrustRegionStrategyKind::kMarquardt) {
    batch.function_tolerance = 0.0;
    // the observer looks at it
    batch.min_trust_region_radius = std::numeric_limits<double>::min();
    batch.max_trust_region_radius = tuning.max_radius;
    batch.initial_trust_region_radius =
        std::min(batch.initial_trust_region_radius, tuning.max_radius);
  } else if (!only) {
    // Far below what may be left: Ceres's rule, of one step only, is to come after the observer's.
    batch.function_tolerance *=
        end == BatchEnd::kToTheEnd ? tuning.no_gain_share : tuning.settled_share;
  }
  // Of a cost next to zero nearly all may be left where the gradient is below Ceres's default, or
  // any constant: it ends a solve where the user says so.
  batch.gradient_tolerance = only ? std::max(batch.gradient_tolerance, options.gradient_tolerance)
                                  : options.gradient_tolerance;
  batch.parameter_tolerance = options.parameter_tolerance;
  batch.min_relative_decrease = options.min_relative_decrease;
  // Neither is Ceres's, so neither is there where its iterates are asked for.
  batch.refine_landmarks = !only && options.max_landmark_refinements > 0;
  batch.reduce_curvature_of_losses = !only;
  return batch;
}

// The order of the verdicts below: a cost that is no number, the user, the observer's rule, a
// limit, and last what Ceres's rule has called convergence.
BatchOutcome RunPart(const BatchCall& call) {
  const IncrementalOptions& options = *call.options;
  UpdateSummary* summary = &call.trace->summary();
  summary->rests_on_refusals = false;
  SolverOptions batch = BatchOptions(options, call.tuning, call.end);
  BatchObserver observer(call);
  batch.observer = &observer;
  LoopOptions loop;
  loop.judge = &observer;
  loop.fixed_cost = options.fixed_cost;
  Summary solved;
  SolveWith(batch, loop, call.graph, call.solver, &solved);
  Count(solved, observer, summary);
  // The summary of the batch solver has the lowest cost seen; here the cost belongs to the state.
  const bool cost_of_state = solved.IsSolutionUsable() && !solved.iterations.empty();
  summary->final_cost = cost_of_state ? observer.cost() : solved.final_cost;
  summary->ended_by_batch_rule = false;
  if (!std::isfinite(solved.final_cost)) {  // which Ceres 2.1 takes for convergence
    summary->message = "The cost is not finite.";
    return {Termination::kFailure};
  }
  if (observer.ended_by_user()) {
    // The user's word ends the Update: nothing is done incrementally after it.
    return {solved.termination, true};
  }
  if (observer.settled()) {
    summary->message = observer.words();
    if (summary->message.empty()) {
      ClaimInWords words;
      words.SayLittleLeft(observer.rest(), summary->final_cost, options.function_tolerance);
      summary->message = words.text();
    }
    return {Termination::kConvergence, true};
  }
  if (observer.stagnates()) {
    summary->message = observer.words();
    return {Termination::kNoConvergence, true};
  }
  if (solved.termination == Termination::kUserSuccess ||
      solved.termination == Termination::kNoConvergence) {
    summary->message = "Stopped by a limit or by request; the state is the best so far.";
    return {Termination::kNoConvergence, true};
  }
  summary->ended_by_batch_rule = solved.termination == Termination::kConvergence;
  const bool held_back = IsHeldBack(solved, observer, batch, call.tuning);
  // Without iterations nothing can move, which is a minimum.
  const bool no_gradient = solved.iterations.empty() ||
                           solved.iterations.back().gradient_max_norm <= batch.gradient_tolerance;
  const bool settled = observer.PromisesLittle(solved.discarded_cost_change) &&
                       observer.HidesLittle() && HasSettled(solved, options, call.tuning);
  return {solved.termination, !held_back && settled, held_back,
          observer.PromisesNothing(solved.discarded_cost_change) || no_gradient};
}

}  // namespace inceres::internal
