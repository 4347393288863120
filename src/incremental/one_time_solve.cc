#include "incremental/one_time_solve.h"

#include <algorithm>
#include <atomic>
#include <vector>

#include "base/stopwatch.h"
#include "incremental/batch_phase.h"

namespace inceres::internal {

// A graph that nobody will remember, solved by the batch solver from beginning to end
// (docs/algorithms.md, "One-time solves and exact windows"). It has at most two parts: the strategy
// that was asked for, as long as it gets on, and Marquardt's rule, which tries all lengths
// of steps, from where that one has come. A second part is taken only if the first has proven
// nothing: out of patience, held back by a shrunk trust region, or ended by Ceres's rule while its
// model still promised more.
//
// Iterations, time and rows of the trace go on counting through both parts. The state is never
// worse than what the first part has reached.

namespace {

// A solve from beginning to end. What the user's strategy does not bring to an end within a while,
// or ends with its trust region shrunk by refusals, where its last steps prove nothing, is gone on
// with by Marquardt's rule.
BatchOutcome RunToTheEnd(const BatchCall& call) {
  const IncrementalOptions& options = *call.options;
  UpdateSummary* summary = &call.trace->summary();
  // With batch_share 0 the iterates are Ceres's to the end.
  const bool in_parts =
      options.batch_share > 0.0 && options.batch_strategy != TrustRegionStrategyKind::kMarquardt;
  const BatchOutcome first = RunPart(call);
  // Ended by the observer, or by the user's limit: that one is looked at below.
  const bool out_of_patience = first.termination == Termination::kNoConvergence &&
                               summary->num_iterations >= call.tuning.patience;
  // The second part has what is left of the time and of the iterations.
  IncrementalOptions part = options;
  const double seconds_left =
      options.max_solver_time_in_seconds - (NowInSeconds() - call.trace->start_seconds());
  part.max_num_iterations = options.max_num_iterations - summary->num_iterations;
  // What ended by the observer's rule has its proof. Ceres's rule looks at one step and needs a
  // model that promises nothing either.
  const bool proven = !first.held_back &&
                      (summary->ended_by_batch_rule ? first.promises_nothing : !out_of_patience);
  if (!in_parts || proven || first.termination == Termination::kFailure ||
      part.max_num_iterations <= 0 || seconds_left <= 0.0) {
    return first;
  }
  part.max_solver_time_in_seconds = seconds_left;
  // It goes on with the damping that the first part has found, where that was not shrunk by
  // refusals.
  if (IsDamped(part.batch_strategy) && !first.held_back) {
    part.initial_damping = std::min(part.initial_damping, summary->iterations.back().damping);
  }
  part.batch_strategy = TrustRegionStrategyKind::kMarquardt;
  // A copy: the batch solver works on the graph's state.
  const std::vector<double> reached = call.graph->state();
  const UpdateSummary before = *summary;
  BatchCall next = call;
  next.options = &part;
  const BatchOutcome second = RunPart(next);
  if (second.termination == Termination::kFailure) {  // what the first part has reached stays
    call.graph->mutable_state() = reached;
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

SolverOptions OneTimeOptions(const IncrementalOptions& options) {
  return BatchOptions(options, TuningOfNewSolvers().batch, BatchEnd::kToTheEnd);
}

void SolveOnce(const IncrementalOptions& options, Solver* solver, FactorGraph* graph,
               UpdateSummary* summary, UpdateObserver* observer, const double** best_state) {
  // Nobody else can ask for a stop; the observer can.
  const std::atomic<bool> stop{false};
  const double* unseen = nullptr;
  *summary = UpdateSummary();
  UpdateTrace trace(observer, summary);
  const Status valid = options.Validate();
  if (valid.ok()) {
    const double** shown = best_state != nullptr ? best_state : &unseen;
    // Only an observer can ask for it back.
    const std::vector<double> start = observer != nullptr ? graph->state() : std::vector<double>();
    summary->termination = RunToTheEnd({&options, TuningOfNewSolvers().batch, BatchEnd::kToTheEnd,
                                        stop, solver, graph, shown, &trace})
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
