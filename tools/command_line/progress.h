#pragma once

#include <cstdio>
#include <string>

#include <ceres/iteration_callback.h>

#include "inceres/solver/solver.h"
#include "tools/command_line/output.h"
#include "tools/command_line/progress_lines.h"

namespace inceres::tools {

/// Prints one line an iteration, in the format of Ceres's own progress table, whoever solves: as a
/// callback of Ceres (stock and shim) and as an observer of the core. Where nobody sees the table,
/// long solves are told as progress.
class ProgressTable : public ceres::IterationCallback, public SolveObserver {
 public:
  ceres::CallbackReturnType operator()(const ceres::IterationSummary& summary) override {
    Print(summary);
    return ceres::SOLVER_CONTINUE;
  }

  ObserverAction EndOfIteration(const IterationSummary& summary,
                                const double* /*best_state*/) override {
    Print(summary);
    return ObserverAction::kContinue;
  }

 private:
  // The two summaries have the same field names.
  template <typename AnySummary>
  void Print(const AnySummary& s) {
    if (s.iteration == 0) {
      std::fputs(
          "iter      cost      cost_change  |gradient|   |step|    tr_ratio  tr_radius  ls_iter  "
          "iter_time  total_time\n",
          Out());
    }
    std::fprintf(Out(),
                 "% 4d % 8e   % 3.2e   % 3.2e  % 3.2e  % 3.2e % 3.2e     % 4d   % 3.2e   % 3.2e\n",
                 s.iteration, s.cost, s.cost_change, s.gradient_max_norm, s.step_norm,
                 s.relative_decrease, s.trust_region_radius, s.linear_solver_iterations,
                 s.iteration_time_in_seconds, s.cumulative_time_in_seconds);
    std::fflush(Out());
    beside_([&] {
      return "iteration " + std::to_string(s.iteration) + ", cost " + std::to_string(s.cost);
    });
  }

  ProgressLines beside_{ProgressOutputBesideTable()};
};

}  // namespace inceres::tools
