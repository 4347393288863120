#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "inceres/export.h"
#include "inceres/status.h"

namespace inceres {

namespace internal {
class SymmetricBlockRows;
}

/// Where the blocks of the symmetric reduced matrix S are: the lower triangle, block rows in order,
/// columns ascending within a row, the diagonal block always present and last in its row. Block k,
/// at (i, j), is d_i × d_j and row-major; its values begin at value_begin[k], row_stride(j) from
/// row to row; of a diagonal block the whole square is stored.
struct BlockPattern {
  /// first scalar row of each block row; one more entry than blocks: the total size
  std::vector<int> offsets;
  std::vector<int> row_begin;  ///< blocks of row i are [row_begin[i], row_begin[i + 1])
  std::vector<int> columns;    ///< block column of each block
  /// Offset of each block's values; one more entry: the total count. In a batch solve blocks follow
  /// each other without a gap.
  std::vector<std::int64_t> value_begin;
  bool padded = false;  ///< rows of a block are padded to whole fours
  /// Per block row: of two that the factor couples, that of the lower group is to be eliminated
  /// first (FactorGraph::SetEliminationGroup). Empty: as the solver likes.
  std::vector<int> groups;

  /// Block rows, as many as frames.
  int num_blocks() const { return static_cast<int>(offsets.size()) - 1; }
  /// Scalar rows.
  int size() const { return offsets.back(); }
  /// Scalar rows of a block row.
  int block_size(int i) const {
    return offsets[static_cast<std::size_t>(i) + 1] - offsets[static_cast<std::size_t>(i)];
  }
  /// From row to row of a block in this column.
  int row_stride(int column) const {
    return padded ? (block_size(column) + 3) / 4 * 4 : block_size(column);
  }
};

/// The symmetric positive definite A = S + diag(diagonal) of the reduced system, as solvers see it,
/// in both modes: a view of what others own. A variable of an incremental solve that is constant
/// for now keeps its rows in the pattern, so that to hold and free it costs no symbolic analysis;
/// but its blocks are left out, its diagonal is 1, and its entries of b are 0.
class INCERES_EXPORT ReducedMatrix {
 public:
  /// Of a batch solve.
  ReducedMatrix(const BlockPattern& pattern, const double* values, const double* diagonal)
      : pattern_(&pattern), values_(values), diagonal_(diagonal) {}
  /// Of an incremental one, in which rows come and go. constant[r] != 0: row r is held; null: none
  /// is.
  ReducedMatrix(const internal::SymmetricBlockRows& rows, const double* diagonal,
                const char* constant)
      : diagonal_(diagonal), rows_(&rows), constant_(constant) {}

  /// Of S. Stays alive, and as it is, until the next ReducedSolver::Analyze.
  const BlockPattern& pattern() const { return pattern_ != nullptr ? *pattern_ : GrownPattern(); }

  /// Calls visit(i, j, block, stride) for the blocks (i, j) of S that are not left out, by rows:
  /// d_i × d_j and row-major, `stride` from row to row. Of a diagonal block the lower triangle
  /// counts.
  template <typename Visit>
  void ForEachBlock(const Visit& visit) const {
    const BlockPattern& blocks = pattern();
    for (int i = 0; i < blocks.num_blocks(); ++i) {
      for (int k = blocks.row_begin[i]; k < blocks.row_begin[i + 1]; ++k) {
        if (const double* block = Block(i, k)) {
          visit(i, blocks.columns[k], block, blocks.row_stride(blocks.columns[k]));
        }
      }
    }
  }
  /// Block k of the pattern, which is in row i; null where it is left out.
  const double* Block(int i, int k) const {
    return rows_ == nullptr ? values_ + pattern_->value_begin[static_cast<std::size_t>(k)]
                            : GrownBlock(i, k);
  }

  /// pattern().size() entries ≥ 0.
  const double* diagonal() const { return diagonal_; }

  /// What row i of the pattern is called in ReducedSolver::Rows, for good: ascending, and i itself
  /// in a batch solve.
  int RowId(int i) const;

  /// The same of an incremental solve by rows that stay where they are, for solvers of our own that
  /// resume; null in a batch solve.
  const internal::SymmetricBlockRows* rows() const { return rows_; }
  const char* constant() const { return constant_; }  ///< per row of these; null: none is

 private:
  const BlockPattern& GrownPattern() const;
  const double* GrownBlock(int i, int k) const;

  const BlockPattern* pattern_ = nullptr;
  const double* values_ = nullptr;
  const double* diagonal_;
  const internal::SymmetricBlockRows* rows_ = nullptr;
  const char* constant_ = nullptr;
};

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
