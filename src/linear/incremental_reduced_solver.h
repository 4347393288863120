#pragma once

#include <cstddef>
#include <vector>

#include "inceres/status.h"
#include "linear/block_rows.h"

namespace inceres::internal {

/// Solves (S + diag(damping)) x = b for a living S, call after call, with what the last call computed. Vectors are packed by
/// block rows: row i starts at the sum of the sizes of the rows before it, and a removed row has no entries.
///
/// Call order: Factorize after every change, then any number of Solve. S, damping and held stay as they are from Factorize to the
/// last Solve. Threads: one caller. The same calls give the same bits.
class IncrementalReducedSolver {
 public:
  /// Some block rows of S: none before first_row, and of those the listed ones, ascending; null: perhaps all.
  struct Rows {
    int first_row = 0;
    const std::vector<int>* rows = nullptr;
  };

  /// What differs from the last Factorize, in S (values, blocks, rows appended or removed), damping or held. A block row stands
  /// for what is stored in it: the blocks (row, column ≤ row). A removed row changed too.
  struct Change : Rows {
    Change() = default;
    Change(int first, const std::vector<int>* listed, bool with_pattern) : Rows{first, listed}, pattern(with_pattern) {}

    bool pattern = true;  ///< a block or a row came or went
  };

  /// Where a solution may be left as it was: a block row has hardly changed if Σ weights[k] · change_k² ≤ threshold over its
  /// scalars k. Threshold 0: nothing is left out, and weights may be null.
  struct Truncation {
    const double* weights = nullptr;  // packed, ≥ 0, for example diag(C)
    double threshold = 0.0;
  };

  /// Work of the last Factorize and the last Solve.
  struct Work {
    int factored_rows = 0;      // block rows of the factor computed, or preconditioner blocks inverted
    int forward_rows = 0;       // block rows substituted forwards
    int solved_rows = 0;        // block rows substituted backwards
    Rows solved;                // x of other block rows was left as it was; the list is good until the next call
    int iterations = 0;         // of PCG
    int reorderings = 0;        // of the rows of S, before or in Factorize
    bool converged = true;      // PCG: the tolerance was reached; if not, x is still a step downhill
    double factor_flops = 0.0;  // of Factorize, as predicted from the pattern; 0 for PCG
  };

  virtual ~IncrementalReducedSolver() = default;

  /// Shown in summaries, for example "resumed Cholesky".
  virtual const char* Name() const = 0;

  /// Brings the factor up to date. `damping` is packed, ≥ 0. held[i] != 0: block row i is constant, its row and column are left
  /// out; null: none is. kSingular names the block row at which S + diag(damping) proved not to be positive definite; what was
  /// right before it remains, and the next Change counts from the last Factorize all the same.
  virtual Status Factorize(const SymmetricBlockRows& S, const double* damping, const char* held, const Change& change) = 0;

  /// x = (S + diag(damping))⁻¹ b, 0 in held rows. In: the last solution, less what the caller has applied of it since; it is what
  /// rows left out keep and what an iteration starts from. b outside changed_b is as in the last Solve, and a row whose part of x
  /// was applied counts as changed. After a row was removed or came back, all of x is written.
  virtual Status Solve(const double* b, const Rows& changed_b, const Truncation& truncation, double* x) = 0;

  const Work& work() const { return work_; }

  /// Memory held.
  virtual std::size_t Bytes() const = 0;

 protected:
  Work work_;
};

}  // namespace inceres::internal
