#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <ceres/solver.h>

#include "inceres/ceres/solve.h"
#include "inceres/solver/incremental_solver.h"
#include "inceres/solver/summary.h"

namespace inceres::tools {

/// One point of a cost curve.
struct CostSample {
  double seconds = 0.0;  ///< since the start of the Solve call, set-up included
  double cost = 0.0;
  bool accepted = false;  ///< false: the cost of a rejected candidate, which no state ever had
};

/// What a tool keeps of one solve, whoever solved it.
struct SolveRecord {
  bool usable = false;
  std::string termination;  ///< "CONVERGENCE", "NO_CONVERGENCE", …
  std::string message;
  std::string linear_solver;
  double initial_cost = -1.0;
  double final_cost = -1.0;
  int iterations = 0;  ///< completed steps, accepted or not; the evaluation of the start is not one
  double seconds = 0.0;  ///< the whole Solve call, by our own clock
  std::vector<CostSample> trace;
  std::vector<std::pair<std::string, double>> stage_seconds;
  std::vector<std::pair<std::string, std::int64_t>> work;  ///< counts; none of stock's
  bool used_stock = false;  ///< the shim handed the problem to stock Ceres
  std::string fallback_reason;
  std::vector<std::string> options_without_effect;
};

/// Record of a solve by stock Ceres.
SolveRecord RecordOf(const ceres::Solver::Summary& summary, double seconds);

/// Record of a solve by the shim. Stages come from the core where the core did the work.
SolveRecord RecordOf(const ceres::Solver::Summary& summary, SolveMode mode,
                     const SolveReport& report, double seconds);

/// Record of a solve by the core alone.
SolveRecord RecordOf(const Summary& summary, double seconds);

/// Record of an incremental solve by the core alone.
SolveRecord RecordOf(const UpdateSummary& summary, double seconds);

/// Seconds until the solve first held a state whose cost was at most (1 + gap) · reference_cost;
/// empty if it never did. Rejected candidates do not count. Requires reference_cost ≥ 0.
std::optional<double> TimeToGap(const std::vector<CostSample>& trace, double reference_cost,
                                double gap);

}  // namespace inceres::tools
