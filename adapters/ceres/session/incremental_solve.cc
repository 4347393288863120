#include "adapters/ceres/session/incremental_solve.h"

#include <algorithm>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "adapters/ceres/exact/callback_observer.h"
#include "adapters/ceres/exact/exact_solve.h"
#include "adapters/ceres/plan/graph_plan.h"
#include "adapters/ceres/plan/landmark_selection.h"
#include "adapters/ceres/plan/option_mapping.h"
#include "adapters/ceres/plan/structure_cache.h"
#include "adapters/ceres/read/factor_shapes.h"
#include "adapters/ceres/read/fixed_cost.h"
#include "adapters/ceres/read/user_state.h"
#include "adapters/ceres/report/incremental_summary.h"
#include "adapters/ceres/report/summary_writer.h"
#include "inceres/solver/incremental_solver.h"
#include "inceres/solver/summary.h"
#include "src/incremental/one_time_solve.h"

namespace inceres::internal {
namespace {

IncrementalOptions WithTimeLeft(const IncrementalOptions& core, double seconds_spent) {
  IncrementalOptions options = core;
  options.max_solver_time_in_seconds = std::max(options.max_solver_time_in_seconds - seconds_spent,
                                                std::numeric_limits<double>::min());
  return options;
}

// One row of an Update's trace as Ceres would tell it: costs with the fixed one, of a refused step
// that of its candidate; the radius is 1 / damping. `result`: what precedes the Update.
IterationSummary ToIterationSummary(const UpdateIteration& row, const UpdateResult& result,
                                    const SolveInput& input) {
  IterationSummary summary;
  summary.iteration = row.iteration + input.last_iteration.value_or(0);
  summary.step_is_valid = row.step != UpdateStep::kNone || row.iteration == 0;
  summary.step_is_successful = row.step_is_successful;
  // cost is that of before: the step was refused
  const double candidate_cost = row.cost - row.cost_change;
  summary.cost = (row.step_is_successful ? row.cost : candidate_cost) + result.fixed_cost;
  summary.cost_change = row.cost_change;
  summary.gradient_max_norm = row.gradient_max_norm;
  summary.gradient_norm = row.gradient_norm;
  summary.step_norm = row.step_norm;
  summary.model_cost_change = row.model_cost_change;
  summary.relative_decrease = row.relative_decrease;
  summary.trust_region_radius = row.damping > 0.0 ? 1.0 / row.damping : row.trust_region_radius;
  summary.linear_solver_iterations = row.linear_solver_iterations;
  summary.iteration_time_in_seconds = row.iteration_time_in_seconds;
  summary.step_solver_time_in_seconds = row.step_solver_time_in_seconds;
  summary.cumulative_time_in_seconds = result.seconds_before + row.cumulative_time_in_seconds;
  return summary;
}

// Keeps Ceres's promises at the end of an iteration of an incremental solve, as CallbackObserver
// does in exact mode, and writes the trace and the seconds of callbacks into the result.
//
// While it lives and update_state_every_iteration is on, the user's memory follows the solve. It
// is as before when this object is gone (an exception out of user code included), unless Keep was
// called.
class IncrementalObserver : public UpdateObserver {
 public:
  // Borrows all for the length of a solve. `write` puts the best state so far into the user's
  // memory.
  IncrementalObserver(const SolveInput& input, std::function<void()> write, UpdateResult* result)
      : input_(input), options_(input.options), write_(std::move(write)), result_(*result) {
    if (options_.update_state) {
      start_values_.emplace(input.view);
    }
  }

  ObserverAction EndOfIteration(const UpdateIteration& iteration) override {
    result_.trace.push_back(ToIterationSummary(iteration, result_, input_));
    if (options_.update_state) {
      write_();
    }
    // from the part before
    const bool is_known = iteration.iteration == 0 && input_.last_iteration.has_value();
    return is_known ? ObserverAction::kContinue
                    : ReportIteration(options_, result_.trace.back(), &result_.callback_seconds);
  }
  // What is in the user's memory stays.
  void Keep() {
    if (start_values_) {
      start_values_->Keep();
    }
  }

 private:
  const SolveInput& input_;
  const ReportOptions options_;
  const std::function<void()> write_;
  UpdateResult& result_;
  std::optional<StartValues> start_values_;  // where there may be something to put back
};

// The end of a solve: what is usable goes to the user's memory by `write`, and everything is told.
template <typename Write>
bool Conclude(UpdateResult* result, IncrementalObserver* observer, const SolveInput& input,
              ceres::Solver::Summary* summary, SolveReport* report, Write&& write) {
  Summary core = ToSummary(*result, input);
  if (core.IsSolutionUsable()) {
    observer->Keep();
    write();
  }
  summary->minimizer_time_in_seconds = input.Seconds() - result->seconds_before;
  return WriteUpdate(std::move(*result), std::move(core), input, summary, report);
}

// Of a solve that goes on, memory shows where it began, unless the user sees every iteration.
void ShowStart(const SolveInput& input) {
  if (input.shown != nullptr && !input.options.update_state_every_iteration) {
    input.shown->PutBack();
  }
}

// Brings the living problem to where the user's is.
Status Follow(const SolveInput& input, IncrementalProblem* living, LandmarkSelection* landmarks,
              ProblemChanges* changes) {
  const ceres::LinearSolverType type = TypeToPlanIncrementally(input.options, input.ordering);
  const ShapeTable shapes = FindShapes(input.view);
  *landmarks = SelectLandmarks(input.view, input.ordering, shapes, type);
  return living->Follow({input.view, shapes, *landmarks, LandmarksAreGiven(input.ordering, type)},
                        changes);
}

bool Minimize(const SolveInput& input, const IncrementalOptions& core_options,
              IncrementalProblem* living, ceres::Solver::Summary* summary, SolveReport* report) {
  UpdateResult result;
  result.fixed_cost = summary->fixed_cost;
  LandmarkSelection landmarks;
  const Status status = Follow(input, living, &landmarks, &result.changes);
  result.landmarks = landmarks;
  if (!status.ok()) {
    return Fail(status.message, summary);
  }
  ShowStart(input);
  result.num_landmarks = living->num_landmarks();
  result.iterates_in_batch = IteratesInBatch(input.options, core_options);
  WriteLinearSolver(input.view, input.ordering, landmarks,
                    IncrementalLinearSolver(input.options, input.ordering), summary);
  result.seconds_before = summary->preprocessor_time_in_seconds = input.Seconds();
  living->solver().SetOptions(WithTimeLeft(core_options, result.seconds_before));
  IncrementalObserver observer(
      input, [&] { living->WriteToUser(input.view); }, &result);
  living->solver().Update(&result.update, &observer);
  return Conclude(&result, &observer, input, summary, report, [&] {
    living->WriteToUser(input.view);
    living->Remember();
  });
}

// A graph of its own, and no one to remember it: the batch solver's from beginning to end.
bool MinimizeOnce(const SolveInput& input, const IncrementalOptions& core_options,
                  ceres::Solver::Summary* summary, SolveReport* report) {
  const ceres::LinearSolverType type = IncrementalLinearSolver(input.options, input.ordering);
  UpdateResult result;
  result.fixed_cost = summary->fixed_cost;
  FactorGraph graph;
  const std::vector<StateBlock> blocks = TakeGraph(input, type, &graph, &result.landmarks, summary);
  ShowStart(input);
  NameVariables(blocks, &graph);
  result.num_landmarks = result.landmarks.num_landmarks;
  result.iterates_in_batch = IteratesInBatch(input.options, core_options);
  result.changes.num_added_variables = static_cast<int>(graph.num_variables());
  result.changes.num_added_factors = graph.num_factors();
  result.seconds_before = summary->preprocessor_time_in_seconds = input.Seconds();
  const double* shown_state = nullptr;
  IncrementalObserver observer(
      input, [&] { WriteToUser(blocks, shown_state); }, &result);
  const IncrementalOptions options = WithTimeLeft(core_options, result.seconds_before);
  std::unique_ptr<Solver> solver =
      StructureCache::OfProcess().TakeSolver(OneTimeOptions(options), graph);
  SolveOnce(options, solver.get(), &graph, &result.update, &observer, &shown_state);
  StructureCache::OfProcess().GiveBack(std::move(solver));
  return Conclude(&result, &observer, input, summary, report,
                  [&] { WriteToUser(blocks, graph.state().data()); });
}

}  // namespace

bool LinearizeOnly(const SolveInput& input, const IncrementalOptions& core,
                   IncrementalProblem* living) {
  LandmarkSelection landmarks;
  ProblemChanges changes;
  if (input.Seconds() >= input.options.max_solver_time_in_seconds ||
      !Follow(input, living, &landmarks, &changes).ok()) {
    return false;
  }
  IncrementalOptions options = core;
  options.max_num_iterations = 0;
  options.batch_share = 1.0;  // else the batch solver would have it
  living->solver().SetOptions(options);
  if (living->solver().Update().termination == Termination::kFailure) {
    return false;
  }
  living->Remember();
  return true;
}

bool SolveIncrementally(const SolveInput& input, const IncrementalOptions& core,
                        IncrementalProblem* living, ceres::Solver::Summary* summary,
                        SolveReport* report) {
  WriteGiven(input.options, input.view, summary);
  summary->num_threads_used = core.num_threads;
  const FixedCost fixed = input.fixed_cost.has_value()
                              ? FixedCost{*input.fixed_cost, ""}
                              : EvaluateFixedCost(input.view, /*callback=*/nullptr);
  summary->fixed_cost = fixed.cost;
  bool solved = fixed.error.empty();
  if (!solved) {
    // As Ceres, which has written nothing yet of what a solve works on.
    summary->message = fixed.error;
  } else if (input.view.reduced.num_parameter_blocks > 0) {
    solved = living != nullptr ? Minimize(input, core, living, summary, report)
                               : MinimizeOnce(input, core, summary, report);
  } else {
    // What is living stays as it is: the next solve finds what has changed since.
    WriteNothingToSolve(input, fixed.cost, summary);
    report->options_without_effect =
        IncrementalOptionsWithoutEffect(input.options, LandmarkCounts());
  }
  WriteEnd(input, fixed.error.empty(), summary);
  return solved;
}

}  // namespace inceres::internal
