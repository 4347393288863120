#pragma once

#include <string>
#include <vector>

#include <ceres/problem.h>
#include <ceres/solver.h>

#include "inceres/export.h"
#include "inceres/solver/summary.h"

namespace inceres {

/// How inceres::Solve treats a ceres::Problem.
enum class SolveMode {
  kExact,        ///< follows Ceres's trace: same strategy, same decisions, same termination
  kIncremental,  ///< not available yet: strict callers get an error, others stock Ceres
  kStock,        ///< hands everything to stock Ceres
};

/// Fourth argument of inceres::Solve: what the caller asks for (top) and what happened (bottom).
struct INCERES_EXPORT SolveReport {
  SolveMode mode = SolveMode::kExact;  ///< in
  bool strict = false;                 ///< in: fail with a message instead of handing the problem to stock Ceres

  bool used_stock = false;                          ///< out: stock Ceres solved it
  std::string fallback_reason;                      ///< out: why; empty if we solved it
  std::vector<std::string> options_without_effect;  ///< out: options set away from their default that change nothing here
  int num_landmarks = 0;                            ///< out: blocks eliminated as landmarks
  int num_frames = 0;                               ///< out: variable blocks kept in the reduced system
  Summary core;                                     ///< out: the core's own summary: work counts, seconds per stage
};

/// Solves a ceres::Problem: the same arguments, results and side effects as ceres::Solve, several times sooner. What this version
/// does not support is decided before any side effect and handed to stock Ceres: one log line says so, and `report`, if given,
/// says why.
///
/// Requires what ceres::Solve requires. Cost functions are called directly, with Ceres's calling conventions, only during the
/// call, and never concurrently when options.num_threads is 1. Re-entrant; no global state.
/// Source: design of the shim in docs/swap.md; Ceres 2.1.0's solver contract.
INCERES_EXPORT void Solve(const ceres::Solver::Options& options, ceres::Problem* problem, ceres::Solver::Summary* summary,
                          SolveReport* report = nullptr);

}  // namespace inceres
