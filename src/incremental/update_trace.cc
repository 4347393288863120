#include "incremental/update_trace.h"

#include "base/stopwatch.h"
#include "trust_region/loop_ends.h"

namespace inceres::internal {

// One row an iteration. Whoever takes a step adds to the summary's counts, and the row gets the
// difference since the last one ended, so that no counter is kept twice. Iteration 0 is the state
// that the Update begins with and counts as a success, as in Ceres.

namespace {

// Rows there is room for from the first Update on.
constexpr int kUsualRows = 32;

}  // namespace

UpdateTrace::UpdateTrace(UpdateObserver* observer, UpdateSummary* summary)
    : observer_(observer),
      summary_(*summary),
      start_seconds_(NowInSeconds()),
      row_start_seconds_(start_seconds_) {
  // Later Updates in the same summary find the room there.
  summary_.iterations.reserve(kUsualRows);
}

// What the next row's differences are taken from.
UpdateTrace::Counts UpdateTrace::CountsNow() const {
  return {summary_.num_moved_frames, summary_.num_visited_landmarks,
          summary_.num_relinearized_factors, summary_.num_evaluated_factors,
          summary_.solve_seconds};
}

bool UpdateTrace::EndRow(double cost) {
  const double now = NowInSeconds();
  const Counts counts = CountsNow();
  row_.iteration = static_cast<int>(summary_.iterations.size());
  // The start is no step that could fail.
  row_.step_is_successful = row_.step_is_successful || row_.iteration == 0;
  row_.cost = cost;
  row_.num_moved_frames = counts.moved_frames - row_start_.moved_frames;
  row_.num_visited_landmarks = counts.visited_landmarks - row_start_.visited_landmarks;
  row_.num_relinearized_factors = counts.relinearized_factors - row_start_.relinearized_factors;
  row_.num_evaluated_factors = counts.evaluated_factors - row_start_.evaluated_factors;
  row_.step_solver_time_in_seconds += counts.solve_seconds - row_start_.solve_seconds;
  row_.iteration_time_in_seconds = now - row_start_seconds_;
  row_.cumulative_time_in_seconds = now - start_seconds_;
  summary_.iterations.push_back(row_);
  // The observer may read everything of the row, and end the Update.
  const ObserverAction action =
      observed() ? observer_->EndOfIteration(row_) : ObserverAction::kContinue;
  row_ = UpdateIteration();
  row_start_ = counts;
  // Taken again: what the observer does with its time is not the next row's.
  row_start_seconds_ = NowInSeconds();
  return GoesOn(action, &summary_.termination, &summary_.message);
}

}  // namespace inceres::internal
