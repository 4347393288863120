#pragma once

#include <functional>
#include <memory>

#include "inceres/export.h"
#include "inceres/linear/block_pattern.h"
#include "inceres/status.h"

namespace inceres {

/// The open interface for S δ = b. The built-in solvers (dense and sparse Cholesky, PCG) implement it; implement it to plug in
/// your own and hand a factory to SolverOptions::reduced_solver_factory. See docs/reduced_solver.md for a worked example.
///
/// Call order: Analyze once per pattern, then any number of Factorize, each followed by any number of Solve. One thread calls.
class INCERES_EXPORT ReducedSolver {
 public:
  virtual ~ReducedSolver() = default;

  /// Shown in summaries and error messages, for example "dense Cholesky".
  virtual const char* Name() const = 0;

  /// Announces a pattern. It stays alive and unchanged until the next Analyze: symbolic work belongs here.
  virtual Status Analyze(const BlockPattern& pattern) = 0;

  /// Factors S + diag(diagonal). `values` are laid out by the pattern, `diagonal` has pattern.size() entries ≥ 0. Returns
  /// StatusCode::kSingular when the matrix is not positive definite; the solver then retries with more damping.
  virtual Status Factorize(const double* values, const double* diagonal) = 0;

  /// x = (S + diag(diagonal))⁻¹ b; pattern.size() entries each, not aliased.
  virtual Status Solve(const double* b, double* x) = 0;
};

/// Which built-in solver takes the reduced system S δ = b.
enum class ReducedSolverKind {
  /// By predicted flops: dense for small or full systems, else sparse; in an IncrementalSolver, call by call, kResumed while
  /// little has changed and kSparse when much has.
  kAutomatic,
  kDense,    ///< dense Cholesky of our own
  kSparse,   ///< sparse Cholesky of our own, multifrontal, on as many threads as the solve has
  kResumed,  ///< envelope Cholesky, factored anew only behind the first changed row: IncrementalSolver only
  /// Conjugate gradients. In a batch solve preconditioned by the Cholesky factor of an earlier S, which is renewed when they take
  /// long: steps are right to 1e-4 in the norm of the energy, the cost they promise to 1e-8, so that the iterations are Ceres's
  /// to that accuracy only, and there is nothing to gain where forming S costs more than factoring it. In an IncrementalSolver
  /// with blocks as preconditioner, from the last solution (ICE-BA).
  kPcg,
  kAutomaticInexact,  ///< as kAutomatic, or kPcg where that is predicted to take less: batch solves only
};

using ReducedSolverFactory = std::function<std::unique_ptr<ReducedSolver>()>;

}  // namespace inceres
