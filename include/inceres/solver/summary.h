#pragma once

#include <cstdint>
#include <iosfwd>
#include <string>
#include <vector>

#include "inceres/export.h"

namespace inceres {

/// How a solve or an Update ended.
enum class Termination {
  kConvergence,    ///< a tolerance was reached
  kNoConvergence,  ///< iteration or time limit; the state is the best found
  kFailure,        ///< the state is what it was before the solve; `message` names the cause
  kUserSuccess,    ///< an observer asked to stop and keep the result
  kUserFailure,    ///< an observer asked to abort: the state is what it was before the solve
};

/// "CONVERGENCE", "NO_CONVERGENCE", … as Ceres prints them.
INCERES_EXPORT const char* ToString(Termination termination);

/// Whether the state is the solve's result: not what it was before, for want of a better one.
constexpr bool IsUsable(Termination termination) {
  return termination == Termination::kConvergence || termination == Termination::kNoConvergence ||
         termination == Termination::kUserSuccess;
}

/// One line of the trace. Fields mean what ceres::IterationSummary's do (Ceres 2.1), iteration 0
/// being the start.
struct INCERES_EXPORT IterationSummary {
  int iteration = 0;                  ///< 0 is the start
  bool step_is_valid = false;         ///< the step could be computed and evaluated
  bool step_is_successful = false;    ///< it was accepted
  bool step_is_nonmonotonic = false;  ///< accepted although the cost rose
  /// Taken of the step that was computed: less than 1 where the rest could not be evaluated.
  double step_share = 1.0;
  double cost = 0.0;                 ///< of the new state if accepted, of the candidate if rejected
  double cost_change = 0.0;          ///< cost before − candidate cost
  double gradient_max_norm = 0.0;    ///< max |x − (x ⊞ −g)|
  double gradient_norm = 0.0;        ///< ‖x − (x ⊞ −g)‖
  double step_norm = 0.0;            ///< ‖x − candidate‖, ambient
  double model_cost_change = 0.0;    ///< predicted decrease; not in Ceres's
  double relative_decrease = 0.0;    ///< actual / predicted decrease
  double trust_region_radius = 0.0;  ///< after the step
  int linear_solver_iterations = 0;  ///< 1 of a direct solver
  double iteration_time_in_seconds = 0.0;    ///< of this iteration, seconds
  double step_solver_time_in_seconds = 0.0;  ///< of it in computing the step
  double cumulative_time_in_seconds = 0.0;   ///< since the solve began
};

/// Seconds per stage of the solve, named as the folders that do the work.
struct INCERES_EXPORT StageSeconds {
  double setup = 0.0;              ///< layout, patterns, symbolic analysis
  double residuals = 0.0;          ///< cost-only evaluations
  double jacobians = 0.0;          ///< evaluations with Jacobians, loss correction
  double hessian = 0.0;            ///< H and gradient from Jacobians
  double elimination = 0.0;        ///< landmarks into S and b
  double factorization = 0.0;      ///< Cholesky (or QR) of the reduced system, its solve
  double back_substitution = 0.0;  ///< landmark steps
  double model_cost = 0.0;         ///< the pass over J that predicts the decrease
  double total = 0.0;              ///< of the whole solve, what no other field has included
};

/// How much work a solve was: counts that do not depend on the machine.
struct INCERES_EXPORT WorkCounts {
  int num_residual_evaluations = 0;  ///< cost-only passes over the factors
  int num_jacobian_evaluations = 0;  ///< passes with Jacobians
  int num_linear_solves = 0;         ///< systems solved for a step
  /// iterations of conjugate gradients, where steps come from these
  std::int64_t num_conjugate_gradients = 0;
  /// steps that left landmarks where they were, see
  /// ConjugateGradientsOptions::explicit_schur_complement
  int num_steps_without_landmarks = 0;
  /// steps of single landmarks, SolverOptions::refine_landmarks
  std::int64_t num_refined_landmarks = 0;
  int num_recentered_factors =
      0;                  ///< expansion points moved between iterations, FactorFamily::Recenter
  int num_frames = 0;     ///< variable frames in the reduced system
  int num_landmarks = 0;  ///< eliminated landmarks
  int reduced_size = 0;   ///< scalar unknowns of the reduced system
  std::int64_t num_schur_products = 0;  ///< block products per elimination
  std::int64_t num_dynamic_size_factors =
      0;                   ///< factors served by the dynamic instead of a compile-time kernel
  std::int64_t bytes = 0;  ///< arrays of the solver: Jacobians, H, S, factor
};

/// The line search along clamped steps of a problem with bounds; its evaluations count among all
/// others.
struct INCERES_EXPORT LineSearchSummary {
  int num_steps = 0;                ///< points found wanting
  double cost_seconds = 0.0;        ///< evaluations without slope
  double gradient_seconds = 0.0;    ///< with
  double polynomial_seconds = 0.0;  ///< in finding the next point
  double total_seconds = 0.0;       ///< all of the above
};

/// How large a problem is. What moves: variables that are not constant and that a factor touches.
struct INCERES_EXPORT ProblemSizes {
  int num_variables = 0;           ///< of the graph, constants included, removed ones not
  int num_values = 0;              ///< of them: the sum of their ambient sizes
  int num_moving_variables = 0;    ///< 0 if the options or the graph were refused
  int num_moving_values = 0;       ///< the sum of their ambient sizes
  int num_dimensions = 0;          ///< the sum of their tangent sizes: the unknowns
  int num_factors = 0;             ///< of all families
  std::int64_t num_residuals = 0;  ///< the sum of the factors' residual sizes
};

/// What happened. Everything a caller needs to act on a failure is here; nothing is only logged.
struct INCERES_EXPORT Summary {
  Termination termination = Termination::kFailure;  ///< how it ended
  /// in Ceres's words where Ceres has them
  std::string message = "inceres::Solve was not called.";
  /// the culprit behind a failure or the last invalid step: which factor or variable, and why
  std::string detail;
  /// The first step whose end could not be evaluated, and which was refused as one of infinite
  /// cost: which factor or variable, and why. Empty if there was none.
  std::string failed_step;
  double initial_cost = -1.0;  ///< -1 if the start could not be evaluated
  /// The lowest that was seen, as Ceres has it; −1 if there was no evaluation. That of the state
  /// returned, unless a candidate was refused that cost less, but not by min_relative_decrease of
  /// what its model promised.
  double final_cost = -1.0;
  /// of residual blocks of a ceres::Problem that cannot move, for which no graph has a factor: part
  /// of all costs
  double fixed_cost = 0.0;
  /// of the last step if it ended the solve by the function tolerance: it was not taken
  double discarded_cost_change = 0.0;
  std::vector<IterationSummary> iterations;  ///< the trace, the start included
  int num_successful_steps = -1;             ///< steps accepted, the start included
  int num_unsuccessful_steps = -1;           ///< steps refused
  bool is_constrained = false;               ///< some variable that moves has bounds
  LineSearchSummary line_search;             ///< of problems with bounds
  bool structure_reused = false;             ///< set up by an earlier solve of the same Solver
  /// Jacobians were evaluated anew for each pass over them, as the options said or because there
  /// was no memory for them
  bool recomputed_jacobians = false;
  std::string reduced_solver;  ///< name of the solver of the reduced system
  /// instruction set of the kernels used: "generic", "avx2", "avx512", "neon"
  const char* kernels = "";
  /// "levenberg_marquardt", "marquardt", "dogleg", "subspace_dogleg"
  const char* strategy = "";
  int num_threads = 0;   ///< as the options said
  ProblemSizes sizes;    ///< of the problem
  WorkCounts work;       ///< what was done
  StageSeconds seconds;  ///< how long it took

  /// Whether the state is the best one found, and not that of before the solve.
  bool IsSolutionUsable() const { return IsUsable(termination); }
  /// Termination, costs, iterations, counts and seconds as one JSON object.
  std::string ToJson() const;
  /// One line, as Ceres's: iterations, initial and final cost, termination.
  std::string BriefReport() const;
  /// A page, laid out as Ceres's: sizes, solver, costs, iterations, seconds by stage with how often
  /// in brackets, termination with its message, and the culprit of a failure. For people: its words
  /// may change; programs read the fields or ToJson. The numbers are in the words of the C locale.
  std::string FullReport() const;
};

/// BriefReport, without a line end.
INCERES_EXPORT std::ostream& operator<<(std::ostream& stream, const Summary& summary);

}  // namespace inceres
