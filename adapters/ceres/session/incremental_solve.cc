#include "adapters/ceres/session/incremental_solve.h"

#include <algorithm>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "adapters/ceres/exact/exact_solve.h"
#include "adapters/ceres/plan/graph_builder.h"
#include "adapters/ceres/plan/landmark_selection.h"
#include "adapters/ceres/plan/option_mapping.h"
#include "adapters/ceres/plan/structure_cache.h"
#include "adapters/ceres/read/factor_shapes.h"
#include "adapters/ceres/read/fixed_cost.h"
#include "adapters/ceres/report/incremental_summary.h"
#include "adapters/ceres/report/summary_writer.h"
#include "adapters/ceres/session/incremental_observer.h"
#include "src/incremental/one_time_solve.h"

namespace inceres::internal {
namespace {

IncrementalOptions WithTimeLeft(const IncrementalOptions& core, double seconds_spent) {
  IncrementalOptions options = core;
  options.max_solver_time_in_seconds = std::max(options.max_solver_time_in_seconds - seconds_spent,
                                                std::numeric_limits<double>::min());
  return options;
}

// The end of a solve: what is usable goes to the user's memory by `write`, and everything is told.
template <typename Write>
bool Conclude(UpdateResult* result, IncrementalObserver* observer, const SolveInput& input,
              ceres::Solver::Summary* summary, SolveReport* report, Write&& write) {
  result->trace = observer->TakeTrace();
  result->callback_seconds = observer->callback_seconds();
  Summary core = ToSummary(*result, input);
  if (core.IsSolutionUsable()) {
    observer->Keep();
    write();
  }
  summary->minimizer_time_in_seconds = input.clock.Seconds() - result->seconds_before;
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
  result.seconds_before = summary->preprocessor_time_in_seconds = input.clock.Seconds();
  living->solver().SetOptions(WithTimeLeft(core_options, result.seconds_before));
  IncrementalObserver observer(input.options, input.view, [&] { living->WriteToUser(input.view); },
                               {result.fixed_cost, result.seconds_before, input.last_iteration});
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
  result.seconds_before = summary->preprocessor_time_in_seconds = input.clock.Seconds();
  const double* shown_state = nullptr;
  IncrementalObserver observer(input.options, input.view, [&] { WriteToUser(blocks, shown_state); },
                               {result.fixed_cost, result.seconds_before, input.last_iteration});
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
  if (input.clock.Seconds() >= input.options.max_solver_time_in_seconds ||
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
    summary->termination_type = ceres::FAILURE;
    summary->message = fixed.error;
  } else if (input.view.reduced.num_parameter_blocks > 0) {
    solved = living != nullptr ? Minimize(input, core, living, summary, report)
                               : MinimizeOnce(input, core, summary, report);
  } else {
    // What is living stays as it is: the next solve finds what has changed since.
    summary->linear_solver_ordering_used = summary->linear_solver_ordering_given;
    summary->preprocessor_time_in_seconds = input.clock.Seconds();
    WriteNothingToSolve(fixed.cost, summary);
    ReportNothingToSolve(input, report);
  }
  const double postprocessor_start = input.clock.Seconds();
  if (fixed.error.empty()) {
    WriteReduced(input.view, summary);
  }
  summary->total_time_in_seconds = input.clock.Seconds();
  summary->postprocessor_time_in_seconds = summary->total_time_in_seconds - postprocessor_start;
  return solved;
}

}  // namespace inceres::internal
