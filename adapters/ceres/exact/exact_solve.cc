#include "adapters/ceres/exact/exact_solve.h"

#include <algorithm>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <glog/logging.h>

#include "adapters/ceres/exact/callback_observer.h"
#include "adapters/ceres/exact/gradient_check.h"
#include "adapters/ceres/exact/system_dump.h"
#include "adapters/ceres/plan/graph_plan.h"
#include "adapters/ceres/plan/inner_ordering.h"
#include "adapters/ceres/plan/landmark_selection.h"
#include "adapters/ceres/plan/option_mapping.h"
#include "adapters/ceres/plan/structure_cache.h"
#include "adapters/ceres/read/fixed_cost.h"
#include "adapters/ceres/report/summary_writer.h"

namespace inceres::internal {
namespace {

void NameOptionsWithoutEffect(const SolveInput& input, const LandmarkCounts& landmarks,
                              bool is_constrained, SolveReport* report) {
  report->options_without_effect = OptionsWithoutEffect(input.options, landmarks, is_constrained);
  if (input.asked.conjugate_gradients) {
    report->options_without_effect.emplace_back("SolveOptions::conjugate_gradients");
  }
}

void WriteReport(const SolveInput& input, const LandmarkCounts& landmarks, Summary core,
                 SolveReport* report) {
  report->num_landmarks = landmarks.num_landmarks;
  report->num_frames = input.view.reduced.num_parameter_blocks - landmarks.num_landmarks;
  report->core = std::move(core);
}

// Of a problem that is not minimized.
void WriteReportWithoutSolve(const SolveInput& input, SolveReport* report) {
  NameOptionsWithoutEffect(input, LandmarkCounts(), /*is_constrained=*/false, report);
  WriteReport(input, LandmarkCounts(), Summary(), report);
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

// The factors of the residual blocks that a preconditioner is made of; null if there is none.
std::shared_ptr<const std::vector<FactorId>> SubsetOf(const SolveInput& input) {
  if (input.options.preconditioner_type != ceres::SUBSET) {
    return nullptr;
  }
  const auto& ids = input.options.residual_blocks_for_subset_preconditioner;
  auto subset = std::make_shared<std::vector<FactorId>>();
  FamilyId id = 0;
  for (const GraphPlan::Family& family : input.plan->families) {
    for (std::size_t k = 0; k < family.residuals.size(); ++k) {
      const int r = family.residuals[k];
      if (ids.count(input.view.ids[static_cast<std::size_t>(r)]) > 0) {
        subset->push_back({id, static_cast<std::int32_t>(k)});
      }
    }
    ++id;
  }
  return subset;
}

// Rounds of coordinate descent, if there are to be any; of this graph.
InnerDescent DescentOf(const SolveInput& input, const InnerOrdering& inner) {
  InnerDescent descent;
  descent.groups = GroupsInGraph(inner, *input.plan, input.view.blocks.size());
  descent.tolerance = input.options.inner_iteration_tolerance;
  // A point that stock does not check is not checked.
  descent.asks_as_ceres = input.options.check_gradients;
  return descent;
}

void WriteDescent(const InnerDescent& descent, ceres::Solver::Summary* summary) {
  summary->inner_iterations_used = !descent.groups.empty();
  summary->inner_iteration_time_in_seconds = descent.seconds;
  summary->num_inner_iteration_steps += descent.num_rounds;  // Ceres counts from -1
}

std::vector<VariableId> VariablesOf(const std::vector<int>& blocks, const GraphPlan& plan) {
  std::vector<int> sorted = blocks;
  std::sort(sorted.begin(), sorted.end());
  std::vector<VariableId> variables;
  for (std::size_t id = 0; !sorted.empty() && id < plan.blocks.size(); ++id) {
    if (std::binary_search(sorted.begin(), sorted.end(), plan.blocks[id])) {
      variables.push_back(static_cast<VariableId>(id));
    }
  }
  return variables;
}

// Taken while the residual blocks are there.
SolverOptions OptionsFor(const SolveInput& input, ceres::LinearSolverType type, int num_threads) {
  SolverOptions options = MapOptions(input.options, type);
  options.conjugate_gradients.subset = SubsetOf(input);
  options.num_threads = num_threads;
  options.max_memory_bytes = input.asked.max_memory_bytes;
  return options;
}

LoopOptions LoopAsInCeres(InnerDescent* descent) {
  LoopOptions loop;
  loop.rules = kCeresRules;
  loop.nan_gradient_is_small = true;
  loop.inner_descent = descent->groups.empty() ? nullptr : descent;
  return loop;
}

MakeFamily FamiliesOf(GradientCheck* check) {
  if (check == nullptr) {
    return nullptr;
  }
  return [check](const ProblemView& view, const GraphPlan::Family& family) {
    return check->FamilyOf(view, family);
  };
}

// In Ceres's words.
void LogFailure(ceres::LoggingType logging_type, const Summary& core) {
  LogFailedStep(logging_type, core.failed_step);
  if (core.termination == Termination::kFailure) {
    LOG_IF(WARNING, !core.detail.empty())
        << "inceres: " << core.detail;  // where Ceres prints the residual block's numbers
    LOG(ERROR) << "Terminating: " << core.message;
  }
}

// `check`: of gradients; null: none.
void Minimize(const SolveInput& input, const InnerOrdering& inner, GradientCheck* check,
              ceres::Solver::Summary* summary, SolveReport* report) {
  const ceres::LinearSolverType type = EffectiveLinearSolver(input.options, input.ordering);
  std::optional<SystemDump> dump;
  if (!input.options.trust_region_minimizer_iterations_to_dump.empty()) {
    dump.emplace(input.options, input.view, *input.plan, type);
  }
  SolverOptions options = OptionsFor(input, type, summary->num_threads_used);
  InnerDescent descent = DescentOf(input, inner);
  FactorGraph graph;
  LandmarkCounts landmarks;
  const std::vector<StateBlock> blocks =
      TakeGraph(input, type, &graph, &landmarks, summary, FamiliesOf(check));
  NameVariables(blocks, &graph);
  input.view.ForgetBlocks();

  CallbackObserver observer(input.options, input.evaluation_callback, blocks, summary->fixed_cost);
  if (check != nullptr) {
    observer.set_is_to_abort([check] {
      LOG_IF(ERROR, check->failed()) << "Gradient error detected. Terminating solver.";
      return check->failed();
    });
  }
  options.observer = observer.IsNeeded() ? &observer : nullptr;
  LoopOptions loop = LoopAsInCeres(&descent);
  loop.seconds_spent_before = summary->preprocessor_time_in_seconds = input.Seconds();
  loop.system_observer = dump ? &*dump : nullptr;
  const std::vector<VariableId> eliminated = VariablesOf(input.plan->landmarks.large, *input.plan);
  loop.eliminated = eliminated.empty() ? nullptr : &eliminated;
  landmarks.num_landmarks += static_cast<int>(eliminated.size());
  // As they are before anybody is called back, who may change them: Ceres has a copy.
  const double eta = input.options.eta;
  const ceres::LoggingType logging_type = input.options.logging_type;
  NameOptionsWithoutEffect(input, landmarks, graph.HasBounds(), report);
  std::unique_ptr<Solver> solver = StructureCache::OfProcess().TakeSolver(options, graph);
  Summary core;
  SolveWith(options, loop, &graph, solver.get(), &core);
  StructureCache::OfProcess().GiveBack(std::move(solver));
  AddFixedCost(summary->fixed_cost, &core);
  LogFailure(logging_type, core);
  // After a failure the graph still holds the start, and an update_state_every_iteration is undone.
  WriteToUser(blocks, graph.state().data());
  summary->minimizer_time_in_seconds = input.Seconds() - summary->preprocessor_time_in_seconds;
  WriteSolution(eta, core, summary);
  WriteDescent(descent, summary);
  WriteReport(input, landmarks, std::move(core), report);
  report->callback_seconds = observer.callback_seconds();
}

// What Ceres finds wrong when everything but inner iterations is set up. Not logged: Ceres is
// silent about what fails before its loop.
void WriteFailedSetup(const SolveInput& input, const std::string& error,
                      ceres::Solver::Summary* summary) {
  WriteLinearSolver(input.view, input.ordering, input.plan->landmarks,
                    EffectiveLinearSolver(input.options, input.ordering), summary);
  summary->message = error;
  summary->preprocessor_time_in_seconds = input.Seconds();
  summary->num_linear_solves = 0;
  summary->num_residual_evaluations = summary->num_jacobian_evaluations = 0;
  summary->linear_solver_time_in_seconds = 0.0;
  summary->residual_evaluation_time_in_seconds = 0.0;
  summary->jacobian_evaluation_time_in_seconds = 0.0;
}

// The core solves, whatever else was asked for.
void SolveAsItIs(const SolveInput& input, GradientCheck* check, ceres::Solver::Summary* summary,
                 SolveReport* report) {
  WriteGiven(input.options, input.view, summary);
  summary->num_threads_used = NumThreads(input.options);
  const FixedCost fixed = EvaluateFixedCost(input.view, input.evaluation_callback);
  summary->fixed_cost = fixed.cost;
  const bool anything_to_solve = fixed.error.empty() && input.view.reduced.num_parameter_blocks > 0;
  InnerOrdering inner;
  if (anything_to_solve && input.options.use_inner_iterations) {
    inner = FindInnerOrdering(input.options, input.evaluation_callback, input.view);
    summary->inner_iteration_ordering_used = inner.group_sizes;
  }
  if (anything_to_solve && inner.error.empty()) {
    Minimize(input, inner, check, summary, report);
  } else {
    if (!inner.error.empty()) {
      WriteFailedSetup(input, inner.error, summary);
    } else if (fixed.error.empty()) {
      WriteNothingToSolve(input, fixed.cost, summary);
      summary->minimizer_time_in_seconds = input.Seconds() - summary->preprocessor_time_in_seconds;
    } else {
      // not logged: Ceres is silent about what fails before its loop
      summary->linear_solver_ordering_used = summary->linear_solver_ordering_given;
      summary->preprocessor_time_in_seconds = input.Seconds();
      summary->message = fixed.error;
    }
    WriteReportWithoutSolve(input, report);
  }
  WriteEnd(input, fixed.error.empty(), summary);
}

}  // namespace

std::vector<StateBlock> TakeGraph(const SolveInput& input, ceres::LinearSolverType type,
                                  FactorGraph* graph, LandmarkCounts* landmarks,
                                  ceres::Solver::Summary* summary, const MakeFamily& make_family) {
  *landmarks = input.plan->landmarks;
  std::vector<StateBlock> blocks =
      BuildGraph(input.view, *input.plan, graph, make_family, NumReaders(input.options));
  WriteLinearSolver(input.view, input.ordering, input.plan->landmarks, type, summary);
  input.view.ForgetResidualBlocks();
  if (input.own_plan != nullptr) {
    std::vector<GraphPlan::Family>().swap(input.own_plan->families);  // the graph has them
  }
  return blocks;
}

void SolveExactly(const SolveInput& input, ceres::Solver::Summary* summary, SolveReport* report) {
  if (!input.options.check_gradients) {
    SolveAsItIs(input, /*check=*/nullptr, summary, report);
    return;
  }
  // The evaluation callback is not told: Ceres's own problem of checked cost functions has none.
  GradientCheck check(input.options);
  SolveInput checked = input;
  checked.evaluation_callback = nullptr;
  SolveAsItIs(checked, &check, summary, report);
  if (check.failed()) {
    summary->termination_type = ceres::FAILURE;
    summary->message = check.message();
  }
}

}  // namespace inceres::internal
