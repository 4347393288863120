#include <ostream>

#include "base/formatted.h"
#include "inceres/solver/callbacks.h"
#include "inceres/solver/update_summary.h"
#include "inceres/version.h"
#include "trust_region/report_text.h"

namespace inceres {

// Texts of an Update: the progress table, one line an iteration, and the reports. A '-' after the
// name of a step marks one that was not accepted; the cost of its line is that of the state it has
// left in place.

using internal::Formatted;
using internal::ReportLine;
using internal::ReportSeconds;

std::string UpdateProgressHeading() {
  return "iter  step          cost       cost_change |gradient|    |step|     ra"
         "tio    damping   frames  factors   iter_time  total_time";
}

std::string ProgressRow(const UpdateIteration& row) {
  // The blank flag leaves room for a sign, so that columns stay where they are.
  return Formatted(
      "% 4d  %-9s%c% 8e   % 3.2e   % 3.2e  % 3.2e  % 3.2e % 3.2e  % 6d % 8lld   % 3.2e   % 3.2e",
      row.iteration, ToString(row.step), row.step_is_successful ? ' ' : '-', row.cost,
      row.cost_change, row.gradient_max_norm, row.step_norm, row.relative_decrease, row.damping,
      row.num_moved_frames, static_cast<long long>(row.num_relinearized_factors),
      row.iteration_time_in_seconds, row.cumulative_time_in_seconds);
}

namespace {

// What the Update did, by counts: steps first, then the work behind them.
std::string Work(const UpdateSummary& summary) {
  std::string text = ReportLine("Iterations", summary.num_iterations) +
                     ReportLine("Of the batch solver", summary.num_batch_iterations) +
                     ReportLine("Rejected steps", summary.num_unsuccessful_steps) +
                     ReportLine("Shortened steps", summary.num_shortened_steps) + "\n" +
                     ReportLine("Relinearized factors", summary.num_relinearized_factors) +
                     ReportLine("Evaluated factors", summary.num_evaluated_factors) +
                     ReportLine("Eliminated landmarks", summary.num_eliminated_landmarks) +
                     ReportLine("Factored rows", summary.num_factored_rows) +
                     ReportLine("Solved rows", summary.num_solved_rows) +
                     ReportLine("Moved frames", summary.num_moved_frames) +
                     ReportLine("Visited landmarks", summary.num_visited_landmarks);
  // No line where there are none.
  if (summary.num_undetermined_landmarks > 0) {
    text += ReportLine("Undetermined landmarks", summary.num_undetermined_landmarks);
  }
  return text + ReportLine("Bytes", summary.bytes);
}

std::string Seconds(const UpdateSummary& summary) {
  return "Time (in seconds):\n" + ReportSeconds("  Batch solver", summary.batch_seconds) +
         ReportSeconds("  Linearization, S and b", summary.linearize_seconds) +
         ReportSeconds("  Reduced system", summary.solve_seconds) +
         ReportSeconds("  Active set, landmarks", summary.select_seconds) +
         ReportSeconds("  Steps of landmarks", summary.landmark_seconds) +
         ReportSeconds("  Residual evaluation", summary.evaluate_seconds) +
         ReportSeconds("  Accepting steps", summary.accept_seconds) +
         ReportSeconds("Total", summary.seconds);
}

}  // namespace

// One line, for logs: an Update a frame makes many of them.
std::string UpdateSummary::BriefReport() const {
  return Formatted(
      "inceres Update: Iterations: %d (%d batch), Initial cost: %e, Final cost: %e, "
      "Moved frames: %d, Relinearized factors: %lld, %.3f ms, Termination: %s",
      num_iterations, num_batch_iterations, initial_cost, final_cost, num_moved_frames,
      static_cast<long long>(num_relinearized_factors), 1e3 * seconds, ToString(termination));
}

std::string UpdateSummary::FullReport() const {
  std::string text = internal::ReportTitle("Update Summary", INCERES_VERSION_STRING);
  text += "Cost:\n" + ReportLine("Initial", initial_cost) + ReportLine("Final", final_cost) +
          ReportLine("Change", initial_cost - final_cost) +
          (remaining_decrease < 0.0 ? ReportLine("Left undone", "unknown")
                                    : ReportLine("Left undone", remaining_decrease)) +
          "\n";
  text += Work(*this) + "\n" + Seconds(*this) + "\n" +
          internal::ReportTermination(ToString(termination), message);
  // A refused step is told even where the Update went on and converged.
  return text + (failed_step.empty() ? "" : "Refused step: " + failed_step + "\n");
}

std::ostream& operator<<(std::ostream& stream, const UpdateSummary& summary) {
  return stream << summary.BriefReport();
}

}  // namespace inceres
