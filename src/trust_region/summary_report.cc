#include <algorithm>
#include <ostream>

#include "inceres/solver/callbacks.h"
#include "inceres/solver/summary.h"
#include "inceres/version.h"
#include "trust_region/report_text.h"

namespace inceres {

using internal::Formatted;
using internal::ReportLine;
using internal::ReportSeconds;

// Reports of a batch solve to be read by people: one line, and a page with sizes, solver, costs,
// counts and seconds.

namespace {

// Steps tried: the start is no iteration.
int NumIterations(const Summary& summary) {
  return std::max(0, static_cast<int>(summary.iterations.size()) - 1);
}

// Two columns: of the whole problem, and of what moves.
std::string Sizes(const ProblemSizes& sizes) {
  return Formatted("%45s%25s\n", "Problem", "Moving") +
         ReportLine("Variables", sizes.num_variables, sizes.num_moving_variables) +
         ReportLine("Values", sizes.num_values, sizes.num_moving_values) +
         ReportLine("Dimensions", Formatted("%25s%25d", "", sizes.num_dimensions)) +
         ReportLine("Factors", static_cast<std::int64_t>(sizes.num_factors)) +
         ReportLine("Residuals", sizes.num_residuals);
}

std::string SolverUsed(const Summary& summary) {
  const WorkCounts& work = summary.work;
  std::string text = ReportLine("Trust region strategy", summary.strategy);
  // A solve that ended before its model was made used no linear solver.
  if (!summary.reduced_solver.empty()) {
    text += ReportLine("Linear solver", summary.reduced_solver) +
            ReportLine("Eliminated landmarks", work.num_landmarks) +
            ReportLine("Frames", work.num_frames) + ReportLine("Reduced system", work.reduced_size);
  }
  text += ReportLine("Threads", summary.num_threads) + ReportLine("Kernels", summary.kernels);
  text += summary.recomputed_jacobians ? "Jacobians not kept: evaluated anew for each pass\n" : "";
  return text + (summary.structure_reused ? "Structure of an earlier solve\n" : "");
}

std::string Costs(const Summary& summary) {
  std::string text = "Cost:\n" + ReportLine("Initial", summary.initial_cost);
  // After a failure there is no cost to compare with.
  if (summary.IsSolutionUsable()) {
    text += ReportLine("Final", summary.final_cost) +
            ReportLine("Change", summary.initial_cost - summary.final_cost);
  }
  return text;
}

// Stages with the number of their calls where they are counted.
std::string Seconds(const Summary& summary) {
  const StageSeconds& seconds = summary.seconds;
  const WorkCounts& work = summary.work;
  std::string text =
      "Time (in seconds):\n" + ReportSeconds("Setup", seconds.setup) + "\n" +
      ReportSeconds("  Residual evaluation", seconds.residuals, work.num_residual_evaluations) +
      ReportSeconds("  Jacobian evaluation", seconds.jacobians, work.num_jacobian_evaluations) +
      ReportSeconds("  Hessian", seconds.hessian) +
      ReportSeconds("  Elimination", seconds.elimination) +
      ReportSeconds("  Factorization", seconds.factorization, work.num_linear_solves) +
      ReportSeconds("  Back-substitution", seconds.back_substitution) +
      ReportSeconds("  Model cost", seconds.model_cost);
  // Searches need bounds; without any there is no line.
  if (summary.line_search.num_steps > 0) {
    text += ReportSeconds("  Line search", summary.line_search.total_seconds,
                          summary.line_search.num_steps);
  }
  return text + ReportSeconds("Total", seconds.total);
}

}  // namespace

std::string Summary::BriefReport() const {
  return Formatted(
      "inceres Solve: Iterations: %d, Initial cost: %e, Final cost: %e, Termination: %s",
      NumIterations(*this), initial_cost, final_cost, ToString(termination));
}

std::string Summary::FullReport() const {
  std::string text = internal::ReportTitle("Solver Summary", INCERES_VERSION_STRING);
  text += Sizes(sizes) + "\n" + SolverUsed(*this) + "\n" + Costs(*this) + "\n";
  // -1 where there was nothing to solve.
  text += ReportLine("Iterations", NumIterations(*this)) +
          ReportLine("Successful steps", std::max(0, num_successful_steps)) +
          ReportLine("Unsuccessful steps", std::max(0, num_unsuccessful_steps));
  if (work.num_refined_landmarks > 0) {
    text += ReportLine("Steps of single landmarks", work.num_refined_landmarks);
  }
  text +=
      "\n" + Seconds(*this) + "\n" + internal::ReportTermination(ToString(termination), message);
  // The last error, and the first step that could not be evaluated, if there were any.
  text += detail.empty() ? "" : "Detail: " + detail + "\n";
  return text + (failed_step.empty() ? "" : "Refused step: " + failed_step + "\n");
}

std::ostream& operator<<(std::ostream& stream, const Summary& summary) {
  return stream << summary.BriefReport();
}

// Ceres's progress table, with its widths and its headings (docs/ceres_contract.md, "Callback and
// logging options").
LogSink LogTo(std::ostream& stream) {
  // One flushed line an iteration: who waits sees it at once.
  return [&stream](const std::string& line) { stream << line << std::endl; };
}

std::string ProgressHeading() {
  return "iter      cost      cost_change  |gradient|   |step|    tr_ratio  tr_radius  ls_iter  "
         "iter_time  total_time";
}

std::string ProgressRow(const IterationSummary& iteration) {
  return Formatted("% 4d % 8e   % 3.2e   % 3.2e  % 3.2e  % 3.2e % 3.2e     % 4d   % 3.2e   % 3.2e",
                   iteration.iteration, iteration.cost, iteration.cost_change,
                   iteration.gradient_max_norm, iteration.step_norm, iteration.relative_decrease,
                   iteration.trust_region_radius, iteration.linear_solver_iterations,
                   iteration.iteration_time_in_seconds, iteration.cumulative_time_in_seconds);
}

}  // namespace inceres
