#include "adapters/ceres/report/incremental_summary.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <glog/logging.h>

#include "adapters/ceres/plan/option_mapping.h"
#include "adapters/ceres/read/ceres_version.h"
#include "adapters/ceres/read/selection.h"
#include "adapters/ceres/report/summary_writer.h"
#include "src/base/scientific.h"

namespace inceres::internal {
namespace {

constexpr char kEvaluationFailed[] = "Residual and Jacobian evaluation failed.";
constexpr char kCannotProject[] = "Unable to project initial point onto the feasible set.";
constexpr char kOutOfMemory[] = "Out of memory.";
constexpr char kInvalidSteps[] =
    "Number of consecutive invalid steps more than "
    "Solver::Options::max_num_consecutive_invalid_steps: ";

// A batch solve that ended before it evaluated anything: there is no memory for it, or options do
// not go together. Ceres has no words for that.
bool FailedToBegin(const UpdateSummary& update) {
  return update.iterations.empty() && update.num_relinearized_factors == 0 &&
         update.num_evaluated_factors == 0;
}

// The sentence of Ceres's with which the batch solver has ended as a failure; what follows it there
// names the culprit. Empty: another message.
std::string SentenceOfCeres(const std::string& message) {
  for (const char* sentence :
       {kEvaluationFailed, "projected_gradient_step = Plus(x, -gradient) failed.", kCannotProject,
        "Linear solver failed due to unrecoverable non-numeric causes. Please see the error log "
        "for clues. "}) {
    if (message.rfind(sentence, 0) == 0) {
      return sentence;
    }
  }
  if (message.rfind(kInvalidSteps, 0) != 0) {
    return "";
  }
  const std::size_t end = message.find_first_not_of("0123456789", sizeof kInvalidSteps - 1);
  return message.substr(0, end);
}

// What cannot be evaluated is named by a message of its own, which Ceres has in its log.
std::string MessageOfFailure(const UpdateSummary& update) {
  const std::string sentence = SentenceOfCeres(update.message);
  if (sentence.empty() && (FailedToBegin(update) || update.message == kOutOfMemory)) {
    return update.message;
  }
  // From 2.2 on what fails with the start's evaluation has one message.
  if (kCeresRules == CeresRules::k22 && update.iterations.empty() && sentence != kCannotProject) {
    return "Initial residual and Jacobian evaluation failed.";
  }
  return sentence.empty() ? kEvaluationFailed : sentence;
}

// In Ceres's words (docs/ceres_contract.md, "Termination and messages") where it has any; the
// Update's own are in SolveReport::update.
std::string MessageOf(const UpdateSummary& update, const SolveInput& input, double seconds_before) {
  const ceres::Solver::Options& options = input.options;
  if (update.termination == Termination::kFailure) {
    return MessageOfFailure(update);
  }
  if (update.termination != Termination::kNoConvergence) {
    return update.message;
  }
  const int num_iterations = input.last_iteration.value_or(0) + update.num_iterations;
  if (num_iterations >= options.max_num_iterations) {
    return "Maximum number of iterations reached. Number of iterations: " +
           std::to_string(num_iterations) + ".";
  }
  const double seconds = seconds_before + update.seconds;
  if (seconds >= options.max_solver_time_in_seconds) {
    return std::string("Maximum solver time reached. Total solver time: ") +
           Scientific(seconds).text() +
           " >= " + Scientific(options.max_solver_time_in_seconds).text() + ".";
  }
  return update.message;  // no step at the largest damping; the work budget of a session's options
}

}  // namespace

Summary ToSummary(const UpdateResult& result, const SolveInput& input) {
  const UpdateSummary& update = result.update;
  Summary core;
  core.termination = update.termination;
  core.message = MessageOf(update, input, result.seconds_before);
  const bool failed = update.termination == Termination::kFailure;
  core.detail = failed ? update.message : "";
  core.failed_step = update.failed_step;
  // Without an iteration a failure is one of the start, which then has no cost: both stay -1.
  if (!failed || !result.trace.empty()) {
    core.initial_cost = update.initial_cost + result.fixed_cost;
    // A failure puts the user's memory back.
    core.final_cost = failed ? core.initial_cost : update.final_cost + result.fixed_cost;
  }
  core.fixed_cost = result.fixed_cost;
  core.is_constrained = HasBounds(input.view);
  core.iterations = result.trace;
  const auto successful = [](const IterationSummary& iteration) {
    return iteration.step_is_successful;
  };
  core.num_successful_steps =
      static_cast<int>(std::count_if(core.iterations.begin(), core.iterations.end(), successful));
  core.num_unsuccessful_steps =
      static_cast<int>(core.iterations.size()) - core.num_successful_steps;
  core.reduced_solver = "incremental";
  // there are no whole passes to count
  core.work.num_residual_evaluations = core.work.num_jacobian_evaluations = -1;
  core.work.num_linear_solves = update.num_iterations;
  core.seconds = update.batch_stages;
  core.seconds.residuals += update.evaluate_seconds + update.landmark_seconds;
  core.seconds.jacobians += update.linearize_seconds;
  core.seconds.hessian += update.accept_seconds;  // gradients and right-hand sides
  core.seconds.factorization += update.solve_seconds;
  core.seconds.back_substitution += update.select_seconds;
  core.seconds.total = update.seconds;
  return core;
}

bool Fail(const std::string& message, ceres::Solver::Summary* summary) {
  summary->termination_type = ceres::FAILURE;
  summary->message = message;
  LOG(ERROR) << "Terminating: " << message;
  return false;
}

bool WriteUpdate(UpdateResult result, Summary core, const SolveInput& input,
                 ceres::Solver::Summary* summary, SolveReport* report) {
  WriteSolution(input.options.eta, core, summary);
  // Of the user's memory: a refused step that came lower, which Ceres counts, is not there. After
  // an abort nothing is.
  if (core.termination != Termination::kUserFailure) {
    summary->final_cost = core.final_cost;
  }
  LogFailedStep(input.options.logging_type, core.failed_step);
  const bool usable = core.IsSolutionUsable();
  const bool failed = core.termination == Termination::kFailure;
  LOG_IF(WARNING, failed) << "inceres: " << core.detail;
  report->options_without_effect =
      IncrementalOptionsWithoutEffect(input.options, result.landmarks, result.iterates_in_batch);
  report->num_landmarks = result.num_landmarks;
  report->num_frames = input.view.reduced.num_parameter_blocks - result.num_landmarks;
  report->changes = result.changes;
  report->update = std::move(result.update);
  report->core = std::move(core);
  report->callback_seconds = result.callback_seconds;
  return failed ? Fail(summary->message, summary) : usable;
}

}  // namespace inceres::internal
