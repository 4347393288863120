#pragma once

#include <cstdint>
#include <limits>

#include "inceres/export.h"
#include "inceres/solver/callbacks.h"
#include "inceres/solver/options.h"
#include "inceres/status.h"

namespace inceres {

/// Whether S and b follow a change by difference, or are summed anew from the cached Jacobians. The
/// same up to rounding.
enum class RebuildPolicy {
  kWhenCheaper,  ///< by the blocks that either way would take
  kAlways,       ///< summed anew in each iteration: to tell rounding from other causes
  kNever,        ///< always by difference
};

/// When a factor that was moved is linearized anew.
enum class RelinearizationRule {
  kResidualError,  ///< the error of its old linearization counts in units of the objective
  /// ‖δ_i‖_∞ of one of its variables reaches a threshold in a step (IncrementalSolver's thesis,
  /// EIBA, ICE-BA)
  kStepSize,
};

/// Which matrix the damping μ is added to.
enum class DampingForm {
  kHybrid,  ///< μ diag(C) on frames; on a landmark that of its last elimination, mostly ≥ 1e-6
  /// μ diag(S) on the frames, none on landmarks: for comparison, it does not survive real data
  kThesis,
};

/// Options of an IncrementalSolver. The thresholds are shares of what function_tolerance allows.
struct INCERES_EXPORT IncrementalOptions {
  /// Of a share: what the graph asks for as it is at each Update. Landmarks: 0.1 and 0.03. None, as
  /// in a pose graph: 0.003 and 0, for there steps that mix linearization points, or leave part of
  /// the frames behind, promise what they do not keep.
  static constexpr double kByGraph = -1.0;

  int max_num_iterations = 50;  ///< per Update, ≥ 0
  /// per Update, > 0, looked at between iterations; the best state so far is kept
  double max_solver_time_in_seconds = 1e9;
  /// Work budget per Update, > 0: factors evaluated, with or without Jacobians. Looked at between
  /// iterations.
  std::int64_t max_factor_evaluations = std::numeric_limits<std::int64_t>::max();
  /// ≥ 0: an Update ends when everything left undone, by the model from fresh enough Jacobians, is
  /// less than a share of this times the cost that can change.
  double function_tolerance = 1e-6;
  /// ≥ 0: an Update ends too when max |x − (x ⊞ −g)| is no more than this, over all variables that
  /// move, with g = Jᵀf from Jacobians at the values held: where S and the landmarks say so, old
  /// ones are linearized anew and all gradients summed. 0: never. Costs a pass over all variables
  /// an iteration.
  double gradient_tolerance = 0.0;
  /// ≥ 0: an Update ends too after a step that was taken, not shortened, and with what of the
  /// frames' step was left out is no longer than parameter_tolerance · (‖x‖ + parameter_tolerance),
  /// x being all variables that move; of landmarks those count that the step visits. 0: never, for
  /// in bundle adjustment a few points run off, and against them every step is short.
  double parameter_tolerance = 0.0;
  /// ≥ 0: of the cost, what no variable can move, such as factors whose variables are all constant.
  /// The function tolerance is relative to the rest, as in Ceres; costs are reported with it.
  double fixed_cost = 0.0;
  /// ≥ 0: accept a step iff (actual decrease) / (predicted decrease) exceeds it
  double min_relative_decrease = 1e-3;
  /// ≥ min_damping: μ at the first Update; later ones start from the last μ, at most this
  double initial_damping = 1e-4;
  double min_damping = 1e-8;  ///< > 0, for the gauge may be free
  /// In (0, 1]: where directions weaker than min_damping may have more than the tolerance to gain,
  /// μ goes down to this share of it. 1: never, as for a window that slides, whose gauge is held by
  /// hardly more than rounding, which it would follow from one Update to the next.
  double claim_damping_share = 0.01;
  /// ≥ initial_damping: an Update that needs more ends as a failure to converge
  double max_damping = 1e8;
  /// ≥ 0: an Update in which more than this share of the factors are new or changed goes to the
  /// batch solver first, which is cheaper when everything moves; what is then left undone beyond
  /// the tolerance is finished. 0: every Update is a batch solve and nothing else, iterate for
  /// iterate that of inceres::Solve; 1 or more: no Update ever is. (A graph from which factors were
  /// removed and whose places are still free is never solved in batch.)
  double batch_share = 0.5;
  /// of the batch solver
  TrustRegionStrategyKind batch_strategy = TrustRegionStrategyKind::kLevenbergMarquardt;
  /// Of the batch solver, as SolverOptions::linear_model, reduced_solver, conjugate_gradients and
  /// max_memory_bytes: where it is to take conjugate gradients, and how much it may take. (What the
  /// incremental solver keeps does not count.)
  LinearModelKind batch_linear_model = LinearModelKind::kAutomatic;
  ReducedSolverKind batch_reduced_solver = ReducedSolverKind::kAutomatic;  ///< see there
  ConjugateGradientsOptions batch_conjugate_gradients;                     ///< see there
  std::int64_t batch_max_memory_bytes = 0;                                 ///< see there
  /// ≥ 1: of evaluation and of large factorizations; the result is the same to the last bit
  int num_threads = 1;

  DampingForm damping = DampingForm::kHybrid;  ///< which matrix μ is added to
  /// when a moved factor is linearized anew
  RelinearizationRule relinearization = RelinearizationRule::kResidualError;
  /// θ_r of kResidualError: a factor is linearized anew when the squared error of its old
  /// linearization exceeds this share of function_tolerance · 2F / (number of factors). ≥ 0, or
  /// kByGraph; 0 linearizes every factor that moved.
  double relinearization_share = kByGraph;
  /// ε of kStepSize, > 0, in the units of the tangent spaces. Whatever the rule, convergence is
  /// declared on Jacobians that are fresh enough by the first one only.
  double relinearization_step = 1e-3;

  /// θ_a: frames whose steps together are worth less than this share of the predicted decrease (or
  /// a little of what function_tolerance allows, if that is more) stay put, postponed to a later
  /// iteration or Update. In [0, 1), or kByGraph; 0 moves all.
  double truncation_share = kByGraph;

  /// ≥ 0: after a step of the frames, at most so many Gauss–Newton steps of landmarks alone, taken
  /// by those that could still gain much by themselves (ICE-BA's embedded point iteration). Each
  /// evaluates their factors only. Unless 0, a batch solve takes some too, after steps that creep
  /// (SolverOptions::refine_landmarks), except with batch_share 0.
  int max_landmark_refinements = 5;

  /// ≥ 0: an Update begins with at most so many steps of the frames that have come since the last
  /// one and of the landmarks they see, all other frames held, while these gain much: a new frame
  /// mostly starts far from where it belongs, and until it is there all else need not follow. One
  /// of max_num_iterations is left to the others. Not taken if more than half is new or there is
  /// much of it, nor with truncation_share 0 or kThesis.
  int max_new_frame_steps = 3;

  RebuildPolicy rebuild = RebuildPolicy::kWhenCheaper;               ///< of S and b
  ReducedSolverKind reduced_solver = ReducedSolverKind::kAutomatic;  ///< not kAutomaticInexact
  /// If set, makes the solver for S δ = b instead of a built-in one, for the batch solver too
  /// (docs/reduced_solver.md). It is told what has changed from one call to the next. Read by the
  /// constructor of IncrementalSolver.
  ReducedSolverFactory reduced_solver_factory;

  /// If set, is given a table of the progress of every Update, line by line (ProgressRow).
  LogSink progress;
  /// If set, asked after every iteration of an Update. As with an observer, kTerminateSuccessfully
  /// ends it with the best state so far, kAbort with the values held before it. After an iteration
  /// come the row of progress, the observer, then this; who ends the Update is the last to be
  /// asked.
  ///
  /// With `progress` or `callback` an Update costs what it costs with an observer. What they or the
  /// observer throw passes through Update: the solver then holds the values it held before, and the
  /// next Update works as after a failure.
  UpdateCallback callback;

  /// Each Update ends with a copy of all values and the cost, which other threads then read
  /// (IncrementalSolver::ReadSnapshot). Costs a pass over all variables.
  bool publish_snapshots = false;

  /// What is wrong with these options, the first culprit named.
  Status Validate() const;
};

}  // namespace inceres
