#include "inceres/solver/update_summary.h"

#include <ostream>

#include "base/formatted.h"
#include "base/json_object.h"
#include "inceres/solver/callbacks.h"
#include "inceres/version.h"
#include "trust_region/report_text.h"
#include "trust_region/summary_json.h"

namespace inceres {

using internal::Formatted;
using internal::JsonObject;
using internal::ReportLine;
using internal::ReportSeconds;

// Updates as JSON (docs/json.md has the keys); what people read follows below. Every field of the
// structs is written, whatever the Update came to, in the order in which they declare it but for a
// few, so that a script finds a key without asking how it ended. On one processor counts and costs
// are the same in each run, and doubles have 17 digits: two runs may be compared as text, but for
// their seconds.
//
// What JSON has no number for becomes null. So a radius that is infinite, as it is until a step is
// shortened, reads as null; the cost change of a candidate without a cost is −DBL_MAX, which is a
// number, and stays one.

namespace {

// Keys are read by scripts and stay what they are when a field is renamed: some keep an older
// spelling or word. One row of the trace. Of the batch solver's rows (kBatch) several fields mean
// what they mean in Ceres's summary, which the header says field by field; the keys are the same
// for all kinds of steps, so that the trace is one table.
std::string ToJson(const UpdateIteration& row) {
  return JsonObject()
      .Add("iteration", row.iteration)
      .AddString("step", ToString(row.step))
      .Add("accepted", row.step_is_successful)
      .Add("shortened", row.shortened)
      .Add("refreshed", row.refreshed)
      .Add("cost", row.cost)
      .Add("cost_change", row.cost_change)
      .Add("predicted_change", row.model_cost_change)
      .Add("relative_decrease", row.relative_decrease)
      .Add("step_norm", row.step_norm)
      .Add("gradient_max_norm", row.gradient_max_norm)
      .Add("gradient_norm", row.gradient_norm)
      .Add("damping", row.damping)
      .Add("radius", row.trust_region_radius)
      .Add("num_moved_frames", row.num_moved_frames)
      .Add("num_visited_landmarks", row.num_visited_landmarks)
      .Add("num_relinearised_factors", row.num_relinearized_factors)
      .Add("num_evaluated_factors", row.num_evaluated_factors)
      .Add("num_linear_solver_iterations", row.linear_solver_iterations)
      .Add("seconds", row.iteration_time_in_seconds)
      .Add("solve_seconds", row.step_solver_time_in_seconds)
      .Add("cumulative_seconds", row.cumulative_time_in_seconds)
      .Close();
}

}  // namespace

// Without a default, so that the compiler names a step that is missing here. These words are values
// of the key "step": scripts compare them, and they stay as they are, too. What is not one of the
// four can only come of a number that was cast.
const char* ToString(UpdateStep step) {
  switch (step) {
    case UpdateStep::kNone:
      return "none";
    case UpdateStep::kBatch:
      return "batch";
    case UpdateStep::kFrames:
      return "frames";
    case UpdateStep::kLandmarks:
      return "landmarks";
  }
  return "unknown";
}

// Every field of the summary, then the rows of the trace. First how it ended and the costs, then
// counts, then memory and seconds. `batch_stages` is an object that the batch solver's summary has
// as well, and its own writer makes it: hence AddRaw. ToJson of a row is named with its namespace,
// because in here the plain name is that of the member.
std::string UpdateSummary::ToJson() const {
  return JsonObject()
      .AddString("termination", ToString(termination))
      .AddString("message", message)
      .Add("initial_cost", initial_cost)
      .AddString("failed_step", failed_step)
      .AddString("batch_solver", batch_solver)
      .Add("ended_by_batch_rule", ended_by_batch_rule)
      .Add("rests_on_refusals", rests_on_refusals)
      .Add("final_cost", final_cost)
      .Add("undone", remaining_decrease)
      .Add("num_iterations", num_iterations)
      .Add("num_batch_iterations", num_batch_iterations)
      .Add("num_rejected_steps", num_unsuccessful_steps)
      .Add("num_shortened_steps", num_shortened_steps)
      .Add("num_relinearised_factors", num_relinearized_factors)
      .Add("num_reweighed_factors", num_reweighed_factors)
      .Add("num_recentred_factors", num_recentered_factors)
      .Add("num_evaluated_factors", num_evaluated_factors)
      .Add("num_eliminated_landmarks", num_eliminated_landmarks)
      .Add("num_updated_landmarks", num_updated_landmarks)
      .Add("num_factored_rows", num_factored_rows)
      .Add("num_reorderings", num_reorderings)
      .Add("num_solved_rows", num_solved_rows)
      .Add("num_pcg_iterations", num_pcg_iterations)
      .Add("num_landmark_passes", num_landmark_refinements)
      .Add("num_visited_landmarks", num_visited_landmarks)
      .Add("num_moved_frames", num_moved_frames)
      .Add("num_rebuilds", num_rebuilds)
      .Add("num_drifted_frames", num_drifted_frames)
      .Add("num_parked_landmarks", num_undetermined_landmarks)
      .Add("bytes", bytes)
      .Add("seconds", seconds)
      .Add("batch_seconds", batch_seconds)
      .Add("linearise_seconds", linearize_seconds)
      .Add("solve_seconds", solve_seconds)
      .Add("select_seconds", select_seconds)
      .Add("landmark_seconds", landmark_seconds)
      .Add("evaluate_seconds", evaluate_seconds)
      .Add("accept_seconds", accept_seconds)
      .AddRaw("batch_stages", internal::ToJson(batch_stages))
      .AddArray("iterations", iterations,
                [](const UpdateIteration& row) { return inceres::ToJson(row); })
      .Close();
}

// Texts of an Update: the progress table, one line an iteration, and the reports. A '-' after the
// name of a step marks one that was not accepted; the cost of its line is that of the state it has
// left in place.

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
