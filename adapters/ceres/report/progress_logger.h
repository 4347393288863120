#pragma once

#include <string>

#include <ceres/iteration_callback.h>

namespace inceres::internal {

/// Ceres's progress table: the row of one iteration, preceded by the heading at iteration 0, without the last newline.
std::string ProgressText(const ceres::IterationSummary& iteration);

/// Whether LogProgress would print anything.
bool LogsProgress(bool to_stdout);

/// Prints the row to standard output (flushed) or, without `to_stdout`, to VLOG(1).
void LogProgress(const ceres::IterationSummary& iteration, bool to_stdout);

}  // namespace inceres::internal
