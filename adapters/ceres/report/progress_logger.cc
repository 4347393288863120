#include "adapters/ceres/report/progress_logger.h"

#include <cstdio>
#include <iostream>

#include <glog/logging.h>

namespace inceres::internal {

std::string ProgressText(const ceres::IterationSummary& iteration) {
  char row[256];
  std::snprintf(row, sizeof(row), "% 4d % 8e   % 3.2e   % 3.2e  % 3.2e  % 3.2e % 3.2e     % 4d   % 3.2e   % 3.2e",
                iteration.iteration, iteration.cost, iteration.cost_change, iteration.gradient_max_norm, iteration.step_norm,
                iteration.relative_decrease, iteration.trust_region_radius, iteration.linear_solver_iterations,
                iteration.iteration_time_in_seconds, iteration.cumulative_time_in_seconds);
  const char* heading =
      "iter      cost      cost_change  |gradient|   |step|    tr_ratio  tr_radius  ls_iter  iter_time  total_time\n";
  return iteration.iteration == 0 ? std::string(heading) + row : row;
}

bool LogsProgress(bool to_stdout) {
  return to_stdout || VLOG_IS_ON(1);
}

void LogProgress(const ceres::IterationSummary& iteration, bool to_stdout) {
  if (to_stdout) {
    std::cout << ProgressText(iteration) << std::endl;
  } else {
    VLOG(1) << ProgressText(iteration);
  }
}

}  // namespace inceres::internal
