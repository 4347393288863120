#pragma once

#include <string>
#include <vector>

#include <ceres/solver.h>

#include "adapters/ceres/plan/landmark_selection.h"
#include "adapters/ceres/plan/solve_input.h"
#include "inceres/ceres/solve.h"
#include "inceres/solver/summary.h"
#include "inceres/solver/update_summary.h"

namespace inceres::internal {

/// An Update as an incremental solve of a ceres::Problem tells of it.
struct UpdateResult {
  UpdateSummary update;
  std::vector<IterationSummary> trace;
  LandmarkCounts landmarks;  ///< the choice
  int num_landmarks = 0;     ///< of the problem as it was solved
  ProblemChanges changes;
  double fixed_cost = 0.0;         ///< of what touches no variable block, and is not in the graph
  bool iterates_in_batch = false;  ///< IteratesInBatch, of its options
  double seconds_before = 0.0;     ///< spent before the Update began
  double callback_seconds = 0.0;
};

/// The core's summary of an Update, with the costs of all residual blocks and a message in Ceres's
/// words where it has any.
Summary ToSummary(const UpdateResult& result, const SolveInput& input);

/// Writes what of an Update the Summary and the report have places for. False after a failure,
/// which is logged.
bool WriteUpdate(UpdateResult result, Summary core, const SolveInput& input,
                 ceres::Solver::Summary* summary, SolveReport* report);

/// Ends a solve as a failure, in the log too. False.
bool Fail(const std::string& message, ceres::Solver::Summary* summary);

}  // namespace inceres::internal
