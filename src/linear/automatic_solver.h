#pragma once

#include "linear/resumed_solver.h"
#include "linear/sparse_cholesky.h"

namespace inceres::internal {

/// Takes each factorization to the cheaper of the resumed and the sparse Cholesky, by predicted
/// flops and what a flop costs each. While the changes are near the end of S that is the resumed
/// factor; a change of everything, in an S whose envelope loops have filled, goes to the sparse
/// one. The resumed factor then falls behind. It catches up, or reorders, when the calls since have
/// lost by its absence what that costs: at most twice the flops of who knew what was to come (the
/// ski-rental rule). (The dense Cholesky is no candidate: it never takes fewer flops than the
/// envelope, whose long rows run as fast.)
class AutomaticSolver final : public ReducedSolver {
 public:
  explicit AutomaticSolver(const Executor& executor) : sparse_(executor) {}

  /// Of the solver that took the last factorization.
  const char* Name() const override { return chosen_->Name(); }
  Status Factorize(const ReducedMatrix& A, const Rows& changed) override;
  Status Solve(const double* b, const Rows& changed_b, const Truncation& truncation,
               double* x) override;
  std::size_t Bytes() const override { return resumed_.Bytes() + sparse_.Bytes(); }

 private:
  bool SparseIsCheaper(const ReducedMatrix& A, const ResumedSolver::Plan& plan);

  ResumedSolver resumed_;
  SparseCholesky sparse_;
  // of the pattern analyzed last; 0: none, and the first analysis will tell
  double sparse_flops_ = 0.0;
  // flops by which resumed factorizations exceeded those since the last analysis
  double regret_ = 0.0;
  double saving_ = 0.0;  // flops that a resumed factor which had kept up would have spared since
  ReducedSolver* chosen_ = &resumed_;
};

}  // namespace inceres::internal
