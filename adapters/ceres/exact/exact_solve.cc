#include "adapters/ceres/exact/exact_solve.h"

#include <memory>
#include <utility>

#include <glog/logging.h>

#include "adapters/ceres/exact/callback_observer.h"
#include "adapters/ceres/plan/graph_builder.h"
#include "adapters/ceres/plan/landmark_selection.h"
#include "adapters/ceres/plan/option_mapping.h"
#include "adapters/ceres/plan/structure_cache.h"
#include "adapters/ceres/read/fixed_cost.h"
#include "adapters/ceres/report/summary_writer.h"

namespace inceres::internal {
namespace {

void WriteReport(const SolveInput& input, const LandmarkCounts& landmarks, Summary core,
                 SolveReport* report) {
  report->options_without_effect =
      OptionsWithoutEffect(input.options, landmarks, core.is_constrained);
  report->num_landmarks = landmarks.num_landmarks;
  report->num_frames = input.view.reduced.num_parameter_blocks - landmarks.num_landmarks;
  report->core = std::move(core);
}

// The core knows nothing of residual blocks that cannot move.
void AddFixedCost(double fixed_cost, Summary* core) {
  core->fixed_cost = fixed_cost;
  for (IterationSummary& iteration : core->iterations) {
    iteration.cost += fixed_cost;
  }
  if (!core->iterations.empty()) {  // else there are no costs
    core->initial_cost += fixed_cost;
    core->final_cost += fixed_cost;
  }
}

void Minimize(const SolveInput& input, ceres::Solver::Summary* summary, SolveReport* report) {
  const ceres::LinearSolverType type = EffectiveLinearSolver(input.options, input.ordering);
  FactorGraph graph;
  LandmarkCounts landmarks;
  const std::vector<StateBlock> blocks = TakeGraph(input, type, &graph, &landmarks, summary);
  NameVariables(blocks, &graph);

  CallbackObserver observer(input.options, input.evaluation_callback, blocks, summary->fixed_cost);
  SolverOptions options = MapOptions(input.options, type);
  options.num_threads = summary->num_threads_used;
  options.observer = observer.IsNeeded() ? &observer : nullptr;
  LoopOptions loop;
  loop.rules = kCeresRules;
  loop.seconds_spent_before = summary->preprocessor_time_in_seconds = input.clock.Seconds();
  std::unique_ptr<Solver> solver = StructureCache::OfProcess().TakeSolver(options, graph);
  Summary core;
  SolveWith(options, loop, &graph, solver.get(), &core);
  StructureCache::OfProcess().GiveBack(std::move(solver));
  AddFixedCost(summary->fixed_cost, &core);
  LogFailedStep(input.options, core.failed_step);
  if (core.termination == Termination::kFailure) {
    LOG_IF(WARNING, !core.detail.empty())
        << "inceres: " << core.detail;  // where Ceres prints the residual block's numbers
    LOG(ERROR) << "Terminating: " << core.message;
  }
  // After a failure the graph still holds the start, and an update_state_every_iteration is undone.
  WriteToUser(blocks, graph.state().data());
  summary->minimizer_time_in_seconds =
      input.clock.Seconds() - summary->preprocessor_time_in_seconds;
  WriteSolution(input.options, core, summary);
  WriteReport(input, landmarks, std::move(core), report);
  report->callback_seconds = observer.callback_seconds();
}

}  // namespace

std::vector<StateBlock> TakeGraph(const SolveInput& input, ceres::LinearSolverType type,
                                  FactorGraph* graph, LandmarkCounts* landmarks,
                                  ceres::Solver::Summary* summary) {
  *landmarks = input.plan->landmarks;
  std::vector<StateBlock> blocks = BuildGraph(input.view, *input.plan, graph);
  WriteLinearSolver(input.view, input.ordering, input.plan->landmarks, type, summary);
  input.view.ForgetResidualBlocks();
  return blocks;
}

void SolveExactly(const SolveInput& input, ceres::Solver::Summary* summary, SolveReport* report) {
  WriteGiven(input.options, input.view, summary);
  summary->num_threads_used = NumThreads(input.options);
  const FixedCost fixed = EvaluateFixedCost(input.view, input.evaluation_callback);
  summary->fixed_cost = fixed.cost;
  const bool anything_to_solve = fixed.error.empty() && input.view.reduced.num_parameter_blocks > 0;
  if (anything_to_solve) {
    Minimize(input, summary, report);
  } else {
    summary->linear_solver_ordering_used = summary->linear_solver_ordering_given;
    summary->preprocessor_time_in_seconds = input.clock.Seconds();
    if (!fixed.error.empty()) {
      // not logged: Ceres is silent about what fails before its loop
      summary->message = fixed.error;
    } else {
      WriteNothingToSolve(fixed.cost, summary);
      summary->minimizer_time_in_seconds =
          input.clock.Seconds() - summary->preprocessor_time_in_seconds;
    }
    WriteReport(input, LandmarkCounts(), Summary(), report);
  }
  const double postprocessor_start = input.clock.Seconds();
  if (fixed.error.empty()) {
    WriteReduced(input.view, summary);
  }
  summary->total_time_in_seconds = input.clock.Seconds();
  summary->postprocessor_time_in_seconds = summary->total_time_in_seconds - postprocessor_start;
}

}  // namespace inceres::internal
