#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/executor.h"
#include "inceres/linear/reduced_solver.h"
#include "linear/clique_tree.h"
#include "linear/resuming.h"
#include "linear/tree_rows.h"
#include "linear/tree_substitution.h"

namespace inceres::internal {

/// The sparse Cholesky factor as a Bayes tree that lives as long as the problem: multifrontal, each
/// clique with its columns, its update matrix and its part of y = L⁻¹b.
///
///     Factorize: the cliques in which a block of A is another, and those above them; a new block
///                or row has them ordered anew first (CliqueTree)
///     y = L⁻¹b   those, the cliques of changed entries of b, and what is above
///     x = L⁻ᵀy   from the roots down, where y or an x above has changed ("wildfire")
///
/// Whatever else is kept: what an edit or a step does not reach costs nothing. What the elimination
/// of a clique takes is the dense work of a front, in whole panels.
///
/// The same calls give the same bits, whatever the
/// number of threads, which cut large fronts into strips. Source: Kaess et al., "iSAM2: Incremental
/// smoothing and mapping using the Bayes tree", IJRR 31(2), 2012, algorithms 4, 6 and 7; Liu, "The
/// Multifrontal Method for Sparse Matrix Solution", SIAM Review 34(1), 1992.
class BayesTree : public ReducedSolver, public HalfSolves {
 public:
  explicit BayesTree(const Executor& executor) : executor_(executor) {}
  BayesTree(const BayesTree&) = delete;
  BayesTree& operator=(const BayesTree&) = delete;

  const char* Name() const override { return "Bayes tree"; }
  /// Of an incremental solve: A.rows() is not null.
  Status Factorize(const ReducedMatrix& A, const Rows& changed) override {
    Follow(*A.rows(), changed);
    const Status planned = PlanFor(A);
    return planned.ok() ? FactorizeAsPlanned(A) : (factored_ = planned);
  }
  Status Solve(const double* b, const Rows& changed_b, const Truncation& truncation,
               double* x) override;
  Status SolveForGain(const double* b, const Rows& changed_b, double* gain) override;
  std::size_t Bytes() const override;

  // Factorize in parts, for who wants to know what it costs before.

  /// Remembers what has changed.
  void Follow(const SymmetricBlockRows& S, const Rows& changed) { rows_.Follow(S, changed); }
  /// Brings the tree up to date with what was remembered. kUnavailable when out of memory.
  Status PlanFor(const ReducedMatrix& A);
  /// Flops of what is to be factored.
  double PredictedFlops() const { return flops_; }
  /// How many cliques that is.
  int NumStale() const { return static_cast<int>(stale_.size()); }
  Status FactorizeAsPlanned(const ReducedMatrix& A);

  /// Another solver takes this b and writes x.
  void MissSolve(const Rows& changed_b);

  const CliqueTree& tree() const { return tree_; }
  /// A block of S, which is there now, as it went into the factor; null: it had no such block. Of
  /// an S from which no block was removed since, nor are rows held.
  const double* FactoredBlock(int row, int column, std::int64_t offset) const {
    return rows_.Knows(row, column) ? assembled_.Values(offset) : nullptr;
  }

 private:
  Status RebuildTree(const SymmetricBlockRows& S);
  void FindChangedDiagonal(const ReducedMatrix& A, int row);
  void FindChangedBlocks(const ReducedMatrix& A, int row);
  void MarkStale(int c) { tree_.ClearUpwards(c, &Clique::is_factored, &stale_); }
  void Assemble(const ReducedMatrix& A, int c);
  // The row of S at which the clique is not positive definite; -1: it is.
  int Eliminate(const ReducedMatrix& A, int c);

  const Executor& executor_;
  CliqueTree tree_;
  TreeRows rows_{&tree_};
  TreeSubstitution substitution_{&tree_};
  AssembledMatrix assembled_;
  Status factored_ = Status::Error(StatusCode::kInvalidArgument, "not factored yet");
  double flops_ = 0.0;
  std::int64_t version_ = -1;  // of S's pattern, at the last PlanFor
  std::vector<int> stale_;     // cliques to be factored: with each those above it
  std::vector<int> made_;
  std::vector<int> place_;  // by row: in the front that is being assembled
};

}  // namespace inceres::internal
