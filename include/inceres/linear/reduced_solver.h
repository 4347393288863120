#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <vector>

#include "inceres/export.h"
#include "inceres/linear/reduced_matrix.h"
#include "inceres/status.h"

namespace inceres {

/// The open interface for A δ = b, A = S + diag, in batch and in incremental solves. The built-in
/// solvers implement it; implement it to plug in your own, and hand a factory to SolverOptions or
/// IncrementalOptions::reduced_solver_factory. See docs/reduced_solver.md for a worked example.
/// What is told of changes may be ignored: whoever factors and solves for all of it is right.
///
/// Call order: Analyze before the first Factorize and whenever a block or a row has come or gone;
/// any number of Factorize, each followed by any number of Solve if it succeeded. A stays as it is
/// from Factorize to the last Solve. Vectors are packed as pattern().offsets says. One thread
/// calls; the same calls must give the same bits if solves are to.
class INCERES_EXPORT ReducedSolver {
 public:
  /// Some block rows, by their ids (ReducedMatrix::RowId): none before first_row, and of those the
  /// listed ones, ascending; null: perhaps all. A batch solve says no more than "perhaps all".
  struct Rows {
    int first_row = 0;  ///< none before this one
    /// ids, ascending; null: perhaps all from first_row on
    const std::vector<int>* rows = nullptr;
  };

  /// Where a solution may be left as it was: a block row has hardly changed if Σ weights[k] ·
  /// change_k² ≤ threshold over its scalars k. Threshold 0: nothing is left out, and weights may be
  /// null.
  struct Truncation {
    const double* weights = nullptr;  ///< packed, ≥ 0, for example diag(C)
    double threshold = 0.0;           ///< in the units of weights · x²; ≥ 0
  };

  /// Work of the last Factorize and the last Solve, in block rows; as it is made: that of who does
  /// all of it.
  struct Work {
    static constexpr int kAll = -1;  ///< of a count: all rows that there are
    int factored_rows = kAll;        ///< of the factor computed, or preconditioner blocks inverted
    int forward_rows = kAll;         ///< substituted forwards
    int solved_rows = kAll;          ///< substituted backwards
    /// x of other block rows was left as it was; the list is good until the next call
    Rows solved;
    int iterations = 0;   ///< of conjugate gradients
    int reorderings = 0;  ///< of the rows of S, before or in Factorize
    /// the iteration's tolerance was reached; if not, x is still a step downhill
    bool converged = true;
    double factor_flops = 0.0;  ///< of Factorize, as predicted from the pattern; 0: not known
    /// where Factorize has returned kSingular: the row (ReducedMatrix::RowId) at which A is not
    /// positive definite, for messages; −1: not known
    int failed_row = -1;
  };

  virtual ~ReducedSolver() = default;

  /// Shown in summaries and error messages, for example "dense Cholesky".
  virtual const char* Name() const = 0;

  /// Announces a pattern, for symbolic work. A's values and diagonal may not be there yet.
  virtual Status Analyze(const ReducedMatrix& /*A*/) { return Status::Ok(); }

  /// Factors A. `changed`: what differs from the last Factorize, in values, diagonal or constancy;
  /// a row stands for its blocks (row, column ≤ row), and a removed one changed too. Returns
  /// StatusCode::kSingular when A is not positive definite: it is then tried again with more
  /// damping, and the next `changed` counts from this Factorize all the same.
  virtual Status Factorize(const ReducedMatrix& A, const Rows& changed) = 0;

  /// x = A⁻¹ b, not aliased. In x: the last solution, less what the caller has applied of it since,
  /// which is what rows left out keep and what an iteration may start from. b outside changed_b is
  /// as in the last Solve, and a row whose part of x was applied counts as changed. After a row was
  /// removed or came back, all of x is to be written.
  virtual Status Solve(const double* b, const Rows& changed_b, const Truncation& truncation,
                       double* x) = 0;

  /// What the last Factorize and the last Solve did.
  const Work& work() const { return work_; }

  /// Memory held.
  virtual std::size_t Bytes() const { return 0; }

 protected:
  Work work_;  ///< for the solver to fill
};

/// Which built-in solver takes the reduced system S δ = b. Where a sparse factor is expensive METIS
/// may order it, which seeds the process's rand() anew (docs/determinism.md).
enum class ReducedSolverKind {
  /// By predicted flops: dense for small or full systems, else sparse; in an IncrementalSolver,
  /// call by call, kResumed or a sparse factor that is kept clique by clique (Bayes tree).
  kAutomatic,
  kDense,   ///< dense Cholesky of our own
  kSparse,  ///< sparse Cholesky of our own, multifrontal, on as many threads as the solve has
  /// envelope Cholesky, factored anew only behind the first changed row: IncrementalSolver only
  kResumed,
  /// Conjugate gradients. In a batch solve preconditioned by the Cholesky factor of an earlier S,
  /// which is renewed when they take long: steps are right to 1e-4 in the norm of the energy, the
  /// cost they promise to 1e-8, so that the iterations are Ceres's to that accuracy only, and there
  /// is nothing to gain where forming S costs more than factoring it. In an IncrementalSolver with
  /// blocks as preconditioner, from the last solution (ICE-BA).
  kPcg,
  /// As kAutomatic, or where that is predicted to take less kPcg or, of a graph with landmarks
  /// under LinearModelKind::kAutomatic, conjugate gradients as those of kIterativeSchur, with
  /// kSchurJacobi or kTwoLevel and S formed or not: batch solves only. Source: docs/large.md.
  kAutomaticInexact,
};

/// Makes a solver of yours, for each solve or IncrementalSolver that asks for one.
using ReducedSolverFactory = std::function<std::unique_ptr<ReducedSolver>()>;

}  // namespace inceres
