#include "inceres/solver/update_summary.h"

#include "base/json_object.h"
#include "trust_region/summary_json.h"

namespace inceres {

using internal::JsonObject;

// Updates as JSON (docs/json.md has the keys); what people read is in update_report.cc. Every field
// of the structs is written, whatever the Update came to, in the order in which they declare it but
// for a few, so that a script finds a key without asking how it ended. On one processor counts and
// costs are the same in each run, and doubles have 17 digits: two runs may be compared as text, but
// for their seconds.
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

}  // namespace inceres
