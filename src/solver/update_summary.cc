#include "inceres/solver/update_summary.h"

#include "base/json_object.h"

namespace inceres {

std::string UpdateSummary::ToJson() const {
  return internal::JsonObject()
      .AddString("termination", ToString(termination))
      .AddString("message", message)
      .Add("initial_cost", initial_cost)
      .Add("final_cost", final_cost)
      .Add("undone", undone)
      .Add("num_iterations", num_iterations)
      .Add("num_batch_iterations", num_batch_iterations)
      .Add("num_rejected_steps", num_rejected_steps)
      .Add("num_shortened_steps", num_shortened_steps)
      .Add("num_relinearised_factors", num_relinearised_factors)
      .Add("num_evaluated_factors", num_evaluated_factors)
      .Add("num_eliminated_landmarks", num_eliminated_landmarks)
      .Add("num_updated_landmarks", num_updated_landmarks)
      .Add("num_factored_rows", num_factored_rows)
      .Add("num_solved_rows", num_solved_rows)
      .Add("num_pcg_iterations", num_pcg_iterations)
      .Add("num_landmark_passes", num_landmark_passes)
      .Add("num_visited_landmarks", num_visited_landmarks)
      .Add("num_moved_frames", num_moved_frames)
      .Add("num_rebuilds", num_rebuilds)
      .Add("num_drifted_frames", num_drifted_frames)
      .Add("num_parked_landmarks", num_parked_landmarks)
      .Add("bytes", bytes)
      .Add("seconds", seconds)
      .Add("batch_seconds", batch_seconds)
      .Add("linearise_seconds", linearise_seconds)
      .Add("solve_seconds", solve_seconds)
      .Add("select_seconds", select_seconds)
      .Add("landmark_seconds", landmark_seconds)
      .Add("evaluate_seconds", evaluate_seconds)
      .Add("accept_seconds", accept_seconds)
      .Close();
}

}  // namespace inceres
