#include "adapters/ceres/src/incremental_solve.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include <glog/logging.h>

#include "adapters/ceres/src/ceres_version.h"
#include "adapters/ceres/src/factor_shapes.h"
#include "adapters/ceres/src/fixed_cost.h"
#include "adapters/ceres/src/incremental_observer.h"
#include "adapters/ceres/src/landmark_selection.h"
#include "adapters/ceres/src/option_mapping.h"
#include "adapters/ceres/src/summary_writer.h"
#include "src/base/scientific.h"

namespace inceres::internal {
namespace {

// Costs as Ceres reports them include all residual blocks; the solver's only those in its graph.
struct Costs {
  double fixed = 0.0;    // of what touches no variable block
  double outside = 0.0;  // the part of it that is not in the graph
  std::string error;     // Ceres's message
};

Costs FixedCosts(const ProblemView& view, const LivingProblem& living) {
  Costs costs;
  const FixedCost all = EvaluateFixedCost(view, /*callback=*/nullptr, [&](std::size_t r, double cost) {
    if (!living.Holds(r)) {
      costs.outside += cost;
    }
  });
  costs.fixed = all.cost;
  costs.error = all.error;
  return costs;
}

// In Ceres's words (contract, section 3.4) where it has any; the Update's own are in SolveReport::update.
std::string MessageOf(const UpdateSummary& update, const SolveInput& input, double seconds_before) {
  const ceres::Solver::Options& options = input.options;
  if (update.termination == Termination::kFailure) {
    const bool at_start = update.iterations.empty() && kCeresRules == CeresRules::k22;
    return at_start ? "Initial residual and Jacobian evaluation failed." : "Residual and Jacobian evaluation failed.";
  }
  if (update.message.find(" reached") != std::string::npos) {
    return update.message;  // the batch solver's, which are Ceres's
  }
  if (update.termination == Termination::kConvergence) {
    const double share = update.final_cost > 0.0 ? std::fabs(update.undone) / update.final_cost : 0.0;
    return std::string("Function tolerance reached. |cost_change|/cost: ") + Scientific(share).text() +
           " <= " + Scientific(options.function_tolerance).text();
  }
  if (update.termination != Termination::kNoConvergence) {
    return update.message;
  }
  if (update.num_iterations >= options.max_num_iterations) {
    return "Maximum number of iterations reached. Number of iterations: " + std::to_string(update.num_iterations) + ".";
  }
  const double seconds = seconds_before + update.seconds;
  if (seconds >= options.max_solver_time_in_seconds) {
    return std::string("Maximum solver time reached. Total solver time: ") + Scientific(seconds).text() +
           " >= " + Scientific(options.max_solver_time_in_seconds).text() + ".";
  }
  return update.message;  // no step at the largest damping; the work budget of a session's options
}

Summary ToSummary(const UpdateSummary& update, const SolveInput& input, double seconds_before, const Costs& costs,
                  std::vector<IterationSummary> trace) {
  Summary core;
  core.termination = update.termination;
  core.message = MessageOf(update, input, seconds_before);
  core.detail = update.termination == Termination::kFailure ? update.message : "";
  core.initial_cost = update.initial_cost + costs.outside;
  core.final_cost = update.final_cost + costs.outside;
  core.fixed_cost = costs.fixed;
  core.iterations = std::move(trace);
  const auto successful = [](const IterationSummary& iteration) { return iteration.step_is_successful; };
  core.num_successful_steps = static_cast<int>(std::count_if(core.iterations.begin(), core.iterations.end(), successful));
  core.num_unsuccessful_steps = static_cast<int>(core.iterations.size()) - core.num_successful_steps;
  core.reduced_solver = "incremental";
  core.work.num_residual_evaluations = core.work.num_jacobian_evaluations = -1;  // there are no whole passes to count
  core.work.num_linear_solves = update.num_iterations;
  core.seconds = update.batch_stages;
  core.seconds.residuals += update.evaluate_seconds + update.landmark_seconds;
  core.seconds.jacobians += update.linearise_seconds;
  core.seconds.hessian += update.accept_seconds;  // gradients and right-hand sides
  core.seconds.factorization += update.solve_seconds;
  core.seconds.back_substitution += update.select_seconds;
  core.seconds.total = update.seconds;
  return core;
}

void WriteReport(const SolveInput& input, const LandmarkSelection& landmarks, int num_landmarks, const ProblemChanges& changes,
                 const UpdateSummary& update, Summary core, SolveReport* report) {
  if (report != nullptr) {
    report->options_without_effect = IncrementalOptionsWithoutEffect(input.options, landmarks);
    report->num_landmarks = num_landmarks;
    report->num_frames = input.view.reduced.num_parameter_blocks - num_landmarks;
    report->changes = changes;
    report->update = update;
    report->core = std::move(core);
  }
}

bool Fail(const std::string& message, ceres::Solver::Summary* summary) {
  summary->termination_type = ceres::FAILURE;
  summary->message = message;
  LOG(ERROR) << "Terminating: " << message;
  return false;
}

bool Minimize(const SolveInput& input, const IncrementalOptions& core_options, LivingProblem* living,
              ceres::Solver::Summary* summary, SolveReport* report) {
  const ceres::LinearSolverType type = IncrementalLinearSolver(input.options, input.ordering);
  const ShapeTable shapes = FindShapes(input.view);
  const LandmarkSelection landmarks = SelectLandmarks(input.view, input.ordering, shapes, type);
  ProblemChanges changes;
  const Status status = living->Follow({input.view, shapes, landmarks, LandmarksAreGiven(input.ordering, type)}, &changes);
  if (!status.ok()) {
    return Fail(status.message, summary);
  }
  const Costs costs = FixedCosts(input.view, *living);
  summary->fixed_cost = costs.fixed;
  if (!costs.error.empty()) {
    return Fail(costs.error, summary);
  }
  WriteLinearSolver(input.view, input.ordering, landmarks, type, summary);
  const double seconds_before = input.clock.Seconds();
  summary->preprocessor_time_in_seconds = seconds_before;
  IncrementalOptions options = core_options;
  options.max_seconds = std::max(options.max_seconds - seconds_before, std::numeric_limits<double>::min());
  living->solver().SetOptions(options);
  IncrementalObserver observer(input.options, input.view, *living, {costs.outside, seconds_before});
  UpdateSummary update;
  living->solver().Update(&update, &observer);
  Summary core = ToSummary(update, input, seconds_before, costs, observer.TakeTrace());
  const bool usable = core.IsSolutionUsable();
  if (usable) {
    observer.Keep();
    living->WriteToUser(input.view);
    living->Remember();
  }
  summary->minimizer_time_in_seconds = input.clock.Seconds() - seconds_before;
  WriteSolution(core, summary);
  const bool failed = core.termination == Termination::kFailure;
  LOG_IF(WARNING, failed) << "inceres: " << core.detail;
  WriteReport(input, landmarks, living->num_landmarks(), changes, update, std::move(core), report);
  if (report != nullptr) {
    report->callback_seconds = observer.callback_seconds();
  }
  return failed ? Fail(summary->message, summary) : usable;
}

}  // namespace

bool SolveIncrementally(const SolveInput& input, const IncrementalOptions& core, LivingProblem* living,
                        ceres::Solver::Summary* summary, SolveReport* report) {
  WriteGiven(input.options, input.view, summary);
  summary->num_threads_used = core.num_threads;
  bool solved = true;
  if (input.view.reduced.num_parameter_blocks > 0) {
    solved = Minimize(input, core, living, summary, report);
  } else {
    // What is living stays as it is: the next solve finds what has changed since.
    const FixedCost fixed = EvaluateFixedCost(input.view, /*callback=*/nullptr);
    summary->fixed_cost = fixed.cost;
    summary->linear_solver_ordering_used = summary->linear_solver_ordering_given;
    summary->preprocessor_time_in_seconds = input.clock.Seconds();
    if (fixed.error.empty()) {
      WriteNothingToSolve(fixed.cost, summary);
    } else {
      solved = Fail(fixed.error, summary);
    }
    WriteReport(input, LandmarkSelection(), 0, ProblemChanges(), UpdateSummary(), Summary(), report);
  }
  const double postprocessor_start = input.clock.Seconds();
  WriteReduced(input.view, summary);
  summary->total_time_in_seconds = input.clock.Seconds();
  summary->postprocessor_time_in_seconds = summary->total_time_in_seconds - postprocessor_start;
  return solved;
}

}  // namespace inceres::internal
