#pragma once

#include "linear/bayes_tree.h"
#include "linear/resumed_solver.h"

namespace inceres::internal {

/// Takes each factorization to the cheaper of the resumed factor and the Bayes tree, by predicted
/// flops and what a flop and a clique cost each. While the changes are near the end of S, and in a
/// small S, that is the resumed factor: it has no tree to keep. Where loops have filled its
/// envelope the tree is. The resumed factor then falls behind. It catches up, or reorders, when the
/// calls since have lost by its absence what that costs: at most twice the flops of who knew what
/// was to come (the ski-rental rule); and as long as it would lose it is asked ever more seldom,
/// the more so if by far. The tree is brought up to date as long as it is chosen, and again when
/// factorizations by the other have cost more than all of it would by what that takes. (The dense
/// Cholesky is no candidate: it never takes fewer flops than the envelope, whose long rows run as
/// fast.)
class AutomaticSolver final : public ReducedSolver, public HalfSolves {
 public:
  explicit AutomaticSolver(const Executor& executor) : tree_(executor) {}

  /// Of the solver that took the last factorization.
  const char* Name() const override { return chosen_->Name(); }
  Status Factorize(const ReducedMatrix& A, const Rows& changed) override;
  Status Solve(const double* b, const Rows& changed_b, const Truncation& truncation,
               double* x) override;
  Status SolveForGain(const double* b, const Rows& changed_b, double* gain) override;
  std::size_t Bytes() const override { return resumed_.Bytes() + tree_.Bytes(); }

  /// The one that took the last factorization.
  ReducedSolver* chosen() const { return chosen_; }

 private:
  void MissSolve(const Rows& changed_b);
  bool TreeIsCheaper(const ReducedMatrix& A, const Rows& changed);
  bool PlanTree(const ReducedMatrix& A);
  bool LooksAtTree(const ReducedMatrix& A, double resumed);

  ResumedSolver resumed_;
  BayesTree tree_;
  double saving_ = 0.0;  // flops that a resumed factor which had kept up would have spared since
  double tree_flops_ = 0.0;  // what the tree took, or would have, when it was looked at last
  double regret_ = 0.0;      // flops by which resumed factorizations exceeded all of it since
  int num_unseen_ = 0;       // factorizations for which it was not asked, since it was
  int num_unasked_ = 0;      // factorizations for which the resumed factor need not be asked
  int pause_ = 0;            // how many that were the last time
  ReducedSolver* chosen_ = &resumed_;
};

}  // namespace inceres::internal
