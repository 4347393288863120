#pragma once

#include "inceres/solver/incremental_solver.h"
#include "inceres/solver/update_summary.h"

namespace inceres::internal {

/// Writes the trace of an Update, one row an iteration, and shows each to the observer. Whoever
/// takes the steps fills in what the row says of them; counts are what those of the summary have
/// grown by since the last row ended, seconds what has passed.
///
/// Allocates when an Update has more rows than any before it in the same summary.
class UpdateTrace {
 public:
  /// The Update begins now. `observer` may be null.
  UpdateTrace(UpdateObserver* observer, UpdateSummary* summary);

  UpdateSummary& summary() { return summary_; }
  double start_seconds() const { return start_seconds_; }
  bool observed() const { return observer_ != nullptr; }

  /// The row under construction.
  UpdateIteration& row() { return row_; }
  /// Ends it at a state of this cost, asks the observer, begins the next. False if the observer
  /// ends the Update: the summary then says how.
  bool EndRow(double cost);

 private:
  struct Counts {
    int moved_frames = 0;
    int visited_landmarks = 0;
    std::int64_t relinearized_factors = 0;
    std::int64_t evaluated_factors = 0;
    double solve_seconds = 0.0;
  };
  Counts CountsNow() const;

  UpdateObserver* const observer_;
  UpdateSummary& summary_;
  const double start_seconds_;
  double row_start_seconds_;
  Counts row_start_;
  UpdateIteration row_;
};

}  // namespace inceres::internal
