#pragma once

#include <cstdint>
#include <iosfwd>
#include <string>
#include <vector>

#include "inceres/export.h"
#include "inceres/solver/summary.h"

namespace inceres {

/// What an iteration of an Update did.
enum class UpdateStep {
  /// no step: the start; the reduced system had no factor; or old Jacobians were renewed before
  /// success was claimed
  kNone,
  kBatch,      ///< one of the batch solver's
  kFrames,     ///< frames of the active set, or new ones alone, and the landmarks behind them
  kLandmarks,  ///< landmarks alone, each accepted or not for itself
};

/// "none", "batch", "frames", "landmarks".
INCERES_EXPORT const char* ToString(UpdateStep step);

/// One line of the trace of an Update, iteration 0 being the start. What follows from a step
/// (residuals, gradients, the linearizations it asks for) counts as part of it. The last solve,
/// which finds out that nothing is left to do, has no line.
struct INCERES_EXPORT UpdateIteration {
  int iteration = 0;                    ///< 0 is the start
  UpdateStep step = UpdateStep::kNone;  ///< what moved
  bool step_is_successful = false;      ///< the state moved; true of the start
  /// Cut to the radius, or refused and tried again, along the dog-leg path. What follows is of the
  /// last try.
  bool shortened = false;
  /// Old Jacobians were renewed, instead of more damping or before success was claimed.
  bool refreshed = false;
  double cost = 0.0;  ///< ½ Σ ρ of the state after it
  /// cost before − cost of the candidate, if refused too; −DBL_MAX if that has none
  double cost_change = 0.0;
  double model_cost_change = 0.0;  ///< the same by the model; 0 of kLandmarks
  double relative_decrease = 0.0;  ///< their ratio
  double step_norm = 0.0;  ///< ‖δ‖ in the tangent spaces; ‖x − candidate‖ of kBatch
  /// With an observer only: max and norm of (b, l), the gradient with the frames' part as it is
  /// when the landmarks follow; at the start and after steps of new frames without the landmarks
  /// these see. Of kBatch as in IterationSummary, always.
  double gradient_max_norm = 0.0;
  double gradient_norm = 0.0;  ///< see gradient_max_norm
  double damping = 0.0;        ///< μ after it; 0 of the batch solver's Dog-Leg
  /// of the trust region after it: infinite unless a step was shortened; Ceres's of kBatch
  double trust_region_radius = 0.0;
  int num_moved_frames = 0;                   ///< frames of the active set
  int num_visited_landmarks = 0;              ///< leaves back-substituted
  std::int64_t num_relinearized_factors = 0;  ///< evaluated with Jacobians
  std::int64_t num_evaluated_factors = 0;     ///< evaluated for their cost
  /// of PCG; 1 if a direct solver solved, 0 if there was nothing to solve
  int linear_solver_iterations = 0;
  double iteration_time_in_seconds = 0.0;    ///< of this iteration
  double step_solver_time_in_seconds = 0.0;  ///< of them in the solver of the reduced system
  double cumulative_time_in_seconds = 0.0;   ///< since the Update began
};

/// What one Update of an IncrementalSolver did: counts, which do not depend on the machine, and
/// seconds.
struct INCERES_EXPORT UpdateSummary {
  Termination termination = Termination::kFailure;  ///< how it ended
  std::string message;                              ///< why; of a failure with the culprit
  std::string failed_step;                          ///< as in Summary
  std::string batch_solver;  ///< Summary::reduced_solver of the batch solver; empty: it had no part
  /// The batch solver's own rules ended it, as Ceres's would: `message` is in Ceres's words.
  bool ended_by_batch_rule = false;
  /// Convergence was concluded from refused steps alone: undamped, the model promised more than the
  /// tolerance, and no step that was tried kept it. So it is at a kink of the cost; it may also be
  /// that a good length of steps was passed over.
  bool rests_on_refusals = false;
  double initial_cost = 0.0;  ///< ½ Σ ρ where it began
  double final_cost = 0.0;    ///< ½ Σ ρ where it ended
  /// What the model saw left to gain before the last step of the frames, or at convergence:
  /// truncated and unvisited parts too. -1 where the end tells nothing of it: the batch solver
  /// was stopped, a gradient or step is below its tolerance, steps were refused or stagnate.
  double remaining_decrease = 0.0;

  int num_iterations = 0;                     ///< solves of the reduced system
  int num_batch_iterations = 0;               ///< of them by the batch solver
  int num_unsuccessful_steps = 0;             ///< given up, not tried again shorter
  int num_shortened_steps = 0;                ///< tried again along the dog-leg path
  std::int64_t num_relinearized_factors = 0;  ///< evaluated with Jacobians
  /// that have another loss and took its weight without being evaluated, but for the loss
  int num_reweighed_factors = 0;
  /// whose expansion point moved between iterations, FactorFamily::Recenter
  int num_recentered_factors = 0;
  std::int64_t num_evaluated_factors = 0;  ///< cost-only, at candidates
  int num_eliminated_landmarks = 0;        ///< taken out of S and put back with new blocks
  int num_updated_landmarks = 0;           ///< whose right-hand side alone followed
  int num_factored_rows = 0;               ///< block rows of the reduced system refactored
  int num_reorderings = 0;           ///< of the reduced system's rows, whose order had aged (loops)
  int num_solved_rows = 0;           ///< block rows substituted backwards
  int num_pcg_iterations = 0;        ///< conjugate-gradient iterations, of all solves
  int num_landmark_refinements = 0;  ///< steps of landmarks alone
  int num_visited_landmarks = 0;     ///< leaves back-substituted
  int num_moved_frames = 0;          ///< over all iterations
  int num_rebuilds = 0;              ///< switch decisions: S and b summed anew
  int num_drifted_frames = 0;  ///< rows of S summed anew because cancellation had eaten digits
  int num_undetermined_landmarks = 0;  ///< without information at the end
  std::int64_t bytes = 0;              ///< of the caches, S and its factor

  double seconds = 0.0;            ///< of the Update
  double batch_seconds = 0.0;      ///< in the batch solver
  double linearize_seconds = 0.0;  ///< evaluation with Jacobians, S and b
  double solve_seconds = 0.0;      ///< of the reduced system
  double select_seconds = 0.0;     ///< active set and back-substitution
  double landmark_seconds = 0.0;   ///< steps of landmarks alone
  double evaluate_seconds = 0.0;   ///< of candidates
  double accept_seconds = 0.0;     ///< residuals, gradients and right-hand sides
  StageSeconds batch_stages;       ///< of batch_seconds

  std::vector<UpdateIteration> iterations;  ///< the trace, the start included

  /// Whether the values are better than before or as good: not after a failure.
  bool IsSolutionUsable() const { return IsUsable(termination); }
  /// One JSON object with every field above. A key stays what it is when its field is renamed.
  std::string ToJson() const;
  /// One line an Update: iterations, costs, how many frames moved and factors were linearized,
  /// milliseconds, termination.
  std::string BriefReport() const;
  /// A page in the layout of Summary::FullReport: costs, iterations, work by kind, seconds by
  /// stage, termination. For people, as that is.
  std::string FullReport() const;
};

/// BriefReport, without a line end.
INCERES_EXPORT std::ostream& operator<<(std::ostream& stream, const UpdateSummary& summary);

}  // namespace inceres
