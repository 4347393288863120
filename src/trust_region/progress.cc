#include <ostream>

#include "base/formatted.h"
#include "inceres/solver/callbacks.h"
#include "inceres/solver/summary.h"

namespace inceres {

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
  return internal::Formatted(
      "% 4d % 8e   % 3.2e   % 3.2e  % 3.2e  % 3.2e % 3.2e     % 4d   % 3.2e   % 3.2e",
      iteration.iteration, iteration.cost, iteration.cost_change, iteration.gradient_max_norm,
      iteration.step_norm, iteration.relative_decrease, iteration.trust_region_radius,
      iteration.linear_solver_iterations, iteration.iteration_time_in_seconds,
      iteration.cumulative_time_in_seconds);
}

}  // namespace inceres
