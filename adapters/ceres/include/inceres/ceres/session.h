#pragma once

#include <memory>
#include <vector>

#include <ceres/problem.h>
#include <ceres/solver.h>

#include "inceres/ceres/solve.h"
#include "inceres/export.h"
#include "inceres/solver/incremental_solver.h"
#include "inceres/solver/live_covariance.h"
#include "inceres/status.h"

namespace inceres {

namespace internal {
struct SolveCall;
void SolveOnceInSession(const SolveCall& call);
}  // namespace internal

/// What a CeresSession is told once.
struct INCERES_EXPORT SessionOptions {
  /// Thresholds and damping limits. What a ceres::Solver::Options says too is taken from there at
  /// each solve: max_num_iterations, max_solver_time_in_seconds, function_tolerance,
  /// min_relative_decrease, num_threads, batch_strategy, and with LM initial_damping.
  IncrementalOptions core;

  /// Whether a residual block that looks the same (same id, cost function, loss and parameter
  /// blocks) must prove it by evaluating to the same residual before its Jacobian is used again.
  /// Turn it off only if no address of a cost function is ever used again for another one and no
  /// cost function ever changes: nothing else is left to notice it.
  bool verify_cached_factors = true;

  /// Whether a solve is exact where a window slides: where states are taken out and a prior stands
  /// for what they knew, what a solve leaves undone in weak directions becomes final, and a
  /// trajectory may be several times as wrong although each cost is within the tolerance. So a
  /// problem of a window's size (up to 100 blocks of more than four tangent unknowns, up to 16,384
  /// residual blocks) is solved exactly until 20 solves in a row have passed without a slide, and
  /// one of any size for 20 solves after one. SolveReport::exact_reason tells of it. False, and
  /// with ITERATIVE_SCHUR or CGNR, which no window needs: every solve is incremental.
  bool exact_windows = true;

  /// Whether solves are exact while that takes less work: while most of the problem is not
  /// remembered, which begins where of two exact solves in a row each has converged within 25
  /// iterations, or had at most twice as many residual blocks as the one before, and as counted in
  /// the incremental solves so far; now and then those are tried again. SolveReport::exact_reason
  /// tells, and the log when it changes. To begin to remember evaluates each residual block once
  /// more, after an exact solve.
  bool automatic = false;
};

/// Solves a living ceres::Problem again and again. Between two solves the caller adds and removes
/// residual and parameter blocks, sets constants, moves values, as ever; the session finds out what
/// changed and does the work of that, not of the whole problem.
///
///     inceres::CeresSession session;
///     while (NextFrame(&problem)) {
///       session.Solve(options, &problem, &summary);  // was: ceres::Solve(…)
///     }
///
/// Nothing is believed because an address is the same, for addresses come back:
/// - values are compared with those the session last wrote, bit by bit;
/// - a cost function must evaluate (cost only, where the last solve has ended) to the residual it
///   had there, bit by bit. A residual of zero proves nothing, nor does one that
///   depends on whether Jacobians are asked for; such a residual block, like one that fails, is
///   linearized anew in every solve;
/// - a manifold must have the plus-Jacobian it had; a loss must give the values it gave at 25
///   arguments from 4⁻¹² to 4¹².
/// What these tests cannot see, Forget and Reset tell.
///
/// What incremental steps have not finished after 25 iterations, or have concluded from refused
/// steps alone, the batch solver goes on with, from there and then from the start (docs/swap.md).
///
/// The results are those of SolveMode::kIncremental: a minimum within function_tolerance, not
/// Ceres's trace, nor always Ceres's minimum where there are several. What that mode does not
/// support goes to stock Ceres, for this one call. The problem may also be another one from call to
/// call: what it shares with the last one is found by the same rules.
///
/// User code is called, and user memory touched, only during Solve. Cost: one pass over the
/// problem, with one cost-only evaluation a residual block, plus the work of what changed. Memory:
/// what the core keeps, and the parameters and residual of each residual block. Threads: one at a
/// time; two sessions share nothing. docs/swap.md tells what a session notices.
class INCERES_EXPORT CeresSession {
 public:
  /// Remembers nothing yet; the options hold for the session's life.
  explicit CeresSession(const SessionOptions& options = SessionOptions());
  ~CeresSession();
  CeresSession(const CeresSession&) = delete;
  CeresSession& operator=(const CeresSession&) = delete;

  /// As inceres::Solve in incremental mode, whatever solve_options.mode says. A failure, a
  /// callback's abort and an exception out of user code leave user memory as it was and make the
  /// session forget everything.
  void Solve(const ceres::Solver::Options& options, ceres::Problem* problem,
             ceres::Solver::Summary* summary, const SolveOptions& solve_options = SolveOptions(),
             SolveReport* report = nullptr);
  /// The same with default options, for who wants the report only.
  void Solve(const ceres::Solver::Options& options, ceres::Problem* problem,
             ceres::Solver::Summary* summary, SolveReport* report) {
    Solve(options, problem, summary, SolveOptions(), report);
  }

  /// The joint covariance of these parameter blocks after an incremental solve, in the order given
  /// and in the tangent spaces of their manifolds, from what the solve has left behind, without a
  /// factorization of the whole: IncrementalSolver::Covariance, with its options, costs, threads
  /// and errors. It is that of the problem as last solved: what was added, removed or set constant
  /// since is not in it. A constant block has zeros. (`covariance->variables` are numbers of the
  /// session's own.)
  ///
  /// kInvalidArgument: a block is unknown, given twice, or no longer where the solve has put it; or
  /// nothing is left of the last solve, for it was exact and not remembered, went to stock Ceres,
  /// was refused, failed or had nothing to solve for. Reads the given blocks; with
  /// CovarianceAccuracy::kExact cost functions and manifolds are called, which must still be there.
  /// Source: as there; docs/swap.md.
  Status Covariance(const std::vector<const double*>& parameter_blocks,
                    const LiveCovarianceOptions& options, LiveCovariance* covariance) const;

  /// The next solve linearizes the residual blocks with this cost function anew.
  void Forget(const ceres::CostFunction* cost_function);
  /// The next solve weighs the residual blocks with this loss anew.
  void Forget(const ceres::LossFunction* loss_function);
  /// The next solve starts from nothing, as the first one did.
  void Reset();

 private:
  friend void internal::SolveOnceInSession(const internal::SolveCall& call);

  class INCERES_HIDDEN Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace inceres
