#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <ceres/evaluation_callback.h>
#include <ceres/problem.h>
#include <ceres/solver.h>

#include "inceres/ceres/cross_check.h"
#include "inceres/export.h"
#include "inceres/solver/incremental_solver.h"
#include "inceres/solver/summary.h"

namespace inceres {

/// How inceres::Solve treats a ceres::Problem.
enum class SolveMode {
  kExact,  ///< follows Ceres's trace: same strategy, same decisions, same termination
  /// re-uses Jacobians and what follows from them while they are good enough: to a minimum, to
  /// within function_tolerance, by another path and with less work; of several minima maybe to
  /// another one than Ceres
  kIncremental,
  kStock,  ///< hands everything to stock Ceres
};

/// What the caller of inceres::Solve or CeresSession::Solve asks for.
struct INCERES_EXPORT SolveOptions {
  SolveMode mode = SolveMode::kExact;  ///< a CeresSession does not look at it
  bool strict = false;  ///< fail with a message instead of handing the problem to stock Ceres
  CrossCheckOptions cross_check;  ///< solve with stock Ceres too and compare
  /// A file to which each solve appends one line of JSON with sizes, times and costs of both
  /// solvers; empty: none. Stock solves too, as in a cross-check, and the two take turns in going
  /// first. docs/compare.md, tools/ab_report
  std::string ab_log;

  /// The problem's own ceres::Problem::Options::evaluation_callback, not owned. Ceres up to 2.1
  /// shows it to nobody, so a problem that has one must say so here, or it is not called; from 2.2
  /// on it is seen, and this is not looked at. In exact mode it is called as in Ceres: the point is
  /// copied to the user's memory before each evaluation. In incremental mode such a problem is
  /// solved exactly.
  ceres::EvaluationCallback* evaluation_callback = nullptr;

  /// Of incremental mode: how the batch solver, which takes what is new for the most part, solves
  /// for steps, whatever linear_solver_type says: by conjugate gradients as
  /// LinearModelKind::kIterativeSchur. Not with Dog-Leg. Empty: as linear_solver_type says, where
  /// ITERATIVE_SCHUR on more than 8,192 unknowns means whichever is predicted to take least of a
  /// factor and conjugate gradients with blocks or two levels, with Ceres's eta and limits and
  /// eta_follows_gradient. Source: docs/large.md.
  std::optional<ConjugateGradientsOptions> conjugate_gradients;

  /// SolverOptions::max_memory_bytes of the core: bytes that a solve may take beside the graph that
  /// is made of the problem, ≥ 0; 0: what is left. One that takes more ends with FAILURE and the
  /// figures, everything as it was. Of incremental mode that of the batch solver.
  std::int64_t max_memory_bytes = 0;

  /// CeresSession only: since its last solve, which was of this problem, nothing was added,
  /// removed, or made constant or variable, and no manifold or bound was set. The session then does
  /// not look through the problem again; values may differ.
  bool problem_unedited = false;

  /// No bound was ever set on a parameter block of the problem: then Ceres is not asked for any,
  /// which takes two look-ups for each value, of constant blocks too. The drop-in, which sees the
  /// calls that set them, says so by itself. A bound that is there all the same would be ignored.
  bool problem_has_no_bounds = false;

  /// That of the cross-check. Solve does not need it: a cross-check with invalid options is named
  /// in the log and left out; other options that are invalid end a solve with FAILURE.
  Status Validate() const { return cross_check.Validate(); }
};

/// What the environment of this process asks for; the drop-in solves with it, inceres::Solve only
/// if handed it. The variables are read once, at the first call.
///
/// - `INCERES_MODE`: `exact` (default), `incremental`, `stock`, `auto` (in the drop-in:
///   incremental, and exact while that takes less work, as SessionOptions::automatic; one solve
///   here: exact), `fallback` (in the drop-in: each problem is looked at and handed to stock Ceres;
///   here as `stock`).
/// - `INCERES_WINDOWS`: `exact` (default) or `incremental`: in the drop-in's incremental and auto
///   modes, whether problems of a window's size, and windows that slide, are solved exactly
///   (SessionOptions::exact_windows).
/// - `INCERES_CROSS_CHECK`: `1`, `0`, or what asks for the check with these CrossCheckOptions: a
///   list of `keep=ours`, `keep=stock`, `cost=X`, `parameters=X`, `iterations=N`, `radius=X`,
///   `spread=X`.
/// - `INCERES_AB_LOG`: a file for the A/B log.
///
/// A value that is none of these is named in the log, once, and has no effect; the rest holds. In a
/// program that runs with rights its user has not (setuid, setgid, capabilities) none is looked at.
/// Threads: safe.
INCERES_EXPORT SolveOptions OptionsFromEnvironment();

/// What an incremental solve found different from what it remembered; at a first solve everything
/// is new.
struct INCERES_EXPORT ProblemChanges {
  int num_added_variables = 0;     ///< parameter blocks not seen before
  int num_removed_variables = 0;   ///< parameter blocks that are gone
  int num_revalued_variables = 0;  ///< whose values the caller has changed
  int num_toggled_constants = 0;   ///< made constant or variable
  int num_added_factors = 0;       ///< residual blocks not seen before
  int num_removed_factors = 0;     ///< residual blocks that are gone
  /// same parameter blocks, but not proved to be the same: linearized anew
  int num_replaced_factors = 0;
  int num_kept_factors = 0;    ///< taken over from the last solve
  int num_changed_losses = 0;  ///< kept or replaced factors with another loss
  int num_changed_bounds = 0;  ///< kept variables with other bounds, or none any more
};

/// What happened in a solve.
struct INCERES_EXPORT SolveReport {
  bool used_stock = false;      ///< stock Ceres solved it
  std::string fallback_reason;  ///< why; empty if we solved it
  /// why a solve in incremental mode was exact; empty if it was not
  std::string exact_reason;
  std::vector<std::string>
      options_without_effect;     ///< options set away from their default that change nothing here
  int num_landmarks = 0;          ///< blocks eliminated as landmarks
  int num_frames = 0;             ///< variable blocks kept in the reduced system
  double callback_seconds = 0.0;  ///< spent in the caller's iteration callbacks
  Summary core;                   ///< the core's own summary: work counts, seconds per stage
  ProblemChanges changes;         ///< incremental mode only
  UpdateSummary update;           ///< incremental mode only: the work done
  /// What the cross-check found; null if neither it nor the log was asked for.
  std::shared_ptr<const CrossCheckResult> comparison;
};

/// Solves a ceres::Problem: the same arguments and side effects as ceres::Solve, in less time, and
/// in exact mode the same results up to rounding, which a problem that amplifies it, or has several
/// minima, may show as two of Ceres's own solvers do. What this version does not support is decided
/// before any side effect and handed to stock Ceres: one log line says so, and `*report` says why.
/// It is written anew by each solve, and may be null.
///
/// Requires what ceres::Solve requires. Cost functions are called directly, with Ceres's calling
/// conventions, only during the call, and never concurrently when options.num_threads is 1.
/// Re-entrant.
///
/// A problem built anew with the structure of an earlier one (the same sizes, constants and
/// connections; addresses do not matter) finds elimination order, symbolic factorization, arrays
/// and threads ready: exact mode keeps the solvers of the last few small problems, 64 MiB at most
/// in all, until ForgetStructures. No number is used again. SolveReport::core.structure_reused
/// tells. Source: docs/swap.md; docs/ceres_contract.md, field by field.
INCERES_EXPORT void Solve(const ceres::Solver::Options& options, ceres::Problem* problem,
                          ceres::Solver::Summary* summary,
                          const SolveOptions& solve_options = SolveOptions(),
                          SolveReport* report = nullptr);

/// The same with default options, for who wants the report only.
inline void Solve(const ceres::Solver::Options& options, ceres::Problem* problem,
                  ceres::Solver::Summary* summary, SolveReport* report) {
  Solve(options, problem, summary, SolveOptions(), report);
}

/// Gives back what Solve keeps for problems of a structure it has seen. Threads: at any time.
INCERES_EXPORT void ForgetStructures();

}  // namespace inceres
