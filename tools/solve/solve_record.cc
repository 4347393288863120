#include "tools/solve/solve_record.h"

#include <algorithm>

#include <ceres/types.h>

namespace inceres::tools {
namespace {

// Both iteration summaries have the same field names.
template <typename Iterations>
void FillIterations(const Iterations& iterations, SolveRecord* record) {
  record->iterations = std::max(0, static_cast<int>(iterations.size()) - 1);
  record->trace.reserve(iterations.size());
  for (const auto& iteration : iterations) {
    record->trace.push_back(
        {iteration.cumulative_time_in_seconds, iteration.cost, iteration.step_is_successful});
  }
}

void FillCoreStages(const StageSeconds& seconds, SolveRecord* record) {
  record->stage_seconds = {{"setup", seconds.setup},
                           {"residuals", seconds.residuals},
                           {"jacobians", seconds.jacobians},
                           {"hessian", seconds.hessian},
                           {"elimination", seconds.elimination},
                           {"factorization", seconds.factorization},
                           {"back_substitution", seconds.back_substitution},
                           {"model_cost", seconds.model_cost},
                           {"total", seconds.total}};
}

void FillCoreWork(const WorkCounts& work, SolveRecord* record) {
  record->work = {{"linear_solves", work.num_linear_solves},
                  {"conjugate_gradients", work.num_conjugate_gradients},
                  {"bytes", work.bytes}};
}

// The stages and whole passes of an exact solve mean nothing here.
void FillIncremental(const UpdateSummary& update, SolveRecord* record) {
  record->iterations = update.num_iterations;
  record->linear_solver = "incremental";
  record->stage_seconds = {{"update", update.seconds}};
  record->work = {{"iterations", update.num_iterations},
                  {"rejected_steps", update.num_unsuccessful_steps},
                  {"relinearised_factors", update.num_relinearized_factors},
                  {"evaluated_factors", update.num_evaluated_factors},
                  {"eliminated_landmarks", update.num_eliminated_landmarks},
                  {"factored_rows", update.num_factored_rows},
                  {"conjugate_gradients", update.num_pcg_iterations},
                  {"visited_landmarks", update.num_visited_landmarks},
                  {"moved_frames", update.num_moved_frames},
                  {"parked_landmarks", update.num_undetermined_landmarks}};
}

// Of a solve without a result the message names the culprit, too.
std::string MessageOf(const SolveRecord& record, const Summary& core) {
  return record.usable || core.detail.empty() ? record.message : record.message + ' ' + core.detail;
}

}  // namespace

SolveRecord RecordOf(const ceres::Solver::Summary& summary, double seconds) {
  SolveRecord record;
  record.usable = summary.IsSolutionUsable();
  record.termination = ceres::TerminationTypeToString(summary.termination_type);
  record.message = summary.message;
  record.linear_solver = ceres::LinearSolverTypeToString(summary.linear_solver_type_used);
  record.initial_cost = summary.initial_cost;
  record.final_cost = summary.final_cost;
  record.seconds = seconds;
  FillIterations(summary.iterations, &record);
  record.stage_seconds = {{"preprocessor", summary.preprocessor_time_in_seconds},
                          {"residuals", summary.residual_evaluation_time_in_seconds},
                          {"jacobians", summary.jacobian_evaluation_time_in_seconds},
                          {"linear_solver", summary.linear_solver_time_in_seconds},
                          {"minimizer", summary.minimizer_time_in_seconds},
                          {"postprocessor", summary.postprocessor_time_in_seconds},
                          {"total", summary.total_time_in_seconds}};
  return record;
}

SolveRecord RecordOf(const ceres::Solver::Summary& summary, SolveMode mode,
                     const SolveReport& report, double seconds) {
  SolveRecord record = RecordOf(summary, seconds);
  record.used_stock = report.used_stock;
  record.fallback_reason = report.fallback_reason;
  record.options_without_effect = report.options_without_effect;
  record.message = MessageOf(record, report.core);
  if (!report.used_stock && mode == SolveMode::kIncremental) {
    FillIncremental(report.update, &record);
  } else if (!report.used_stock) {
    record.linear_solver = report.core.reduced_solver;
    FillCoreStages(report.core.seconds, &record);
    FillCoreWork(report.core.work, &record);
  }
  return record;
}

SolveRecord RecordOf(const Summary& summary, double seconds) {
  SolveRecord record;
  record.usable = summary.IsSolutionUsable();
  record.termination = ToString(summary.termination);
  record.message = summary.message;
  record.message = MessageOf(record, summary);
  record.linear_solver = summary.reduced_solver;
  record.initial_cost = summary.initial_cost;
  record.final_cost = summary.final_cost;
  record.seconds = seconds;
  FillIterations(summary.iterations, &record);
  FillCoreStages(summary.seconds, &record);
  FillCoreWork(summary.work, &record);
  return record;
}

SolveRecord RecordOf(const UpdateSummary& summary, double seconds) {
  SolveRecord record;
  record.usable = summary.termination != Termination::kFailure;
  record.termination = ToString(summary.termination);
  record.message = summary.message;
  record.initial_cost = summary.initial_cost;
  record.final_cost = summary.final_cost;
  record.seconds = seconds;
  record.trace = {{seconds - summary.seconds, summary.initial_cost, true},
                  {seconds, summary.final_cost, true}};
  FillIncremental(summary, &record);
  return record;
}

std::optional<double> TimeToGap(const std::vector<CostSample>& trace, double reference_cost,
                                double gap) {
  const auto reached = std::find_if(trace.begin(), trace.end(), [=](const CostSample& sample) {
    return sample.accepted && sample.cost - reference_cost <= gap * reference_cost;
  });
  return reached == trace.end() ? std::nullopt : std::optional<double>(reached->seconds);
}

}  // namespace inceres::tools
