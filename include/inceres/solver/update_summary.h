#pragma once

#include <cstdint>
#include <string>

#include "inceres/export.h"
#include "inceres/solver/summary.h"

namespace inceres {

/// What one Update of an IncrementalSolver did: counts, which do not depend on the machine, and seconds.
struct INCERES_EXPORT UpdateSummary {
  Termination termination = Termination::kFailure;
  std::string message;
  double initial_cost = 0.0;
  double final_cost = 0.0;
  /// What the model says could still be gained at the end: truncated frames, unvisited landmarks, the step not taken.
  double undone = 0.0;

  int num_iterations = 0;
  int num_batch_iterations = 0;  ///< of them by the batch solver
  int num_rejected_steps = 0;
  int num_shortened_steps = 0;  ///< tried again along the dog-leg path
  int num_relinearised_factors = 0;
  std::int64_t num_evaluated_factors = 0;  ///< cost-only, at candidates
  int num_eliminated_landmarks = 0;        ///< taken out of S and put back with new blocks
  int num_updated_landmarks = 0;           ///< whose right-hand side alone followed
  int num_factored_rows = 0;               ///< block rows of the reduced system refactored
  int num_solved_rows = 0;                 ///< block rows substituted backwards
  int num_pcg_iterations = 0;
  int num_landmark_passes = 0;    ///< steps of landmarks alone
  int num_visited_landmarks = 0;  ///< leaves back-substituted
  int num_moved_frames = 0;
  int num_rebuilds = 0;          ///< switch decisions: S and b summed anew
  int num_drifted_frames = 0;    ///< rows of S summed anew because cancellation had eaten digits
  int num_parked_landmarks = 0;  ///< without information at the end
  std::int64_t bytes = 0;        ///< of the caches, S and its factor

  double seconds = 0.0;
  double batch_seconds = 0.0;      ///< in the batch solver
  double linearise_seconds = 0.0;  ///< evaluation with Jacobians, S and b
  double solve_seconds = 0.0;      ///< of the reduced system
  double select_seconds = 0.0;     ///< active set and back-substitution
  double landmark_seconds = 0.0;   ///< steps of landmarks alone
  double evaluate_seconds = 0.0;   ///< of candidates
  double accept_seconds = 0.0;     ///< residuals, gradients and right-hand sides

  /// One JSON object with every field above.
  std::string ToJson() const;
};

}  // namespace inceres
