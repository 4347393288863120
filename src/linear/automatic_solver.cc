#include "linear/automatic_solver.h"

#include <algorithm>

namespace inceres::internal {
namespace {

// CHOLMOD reaches 1 to 5 GFlop/s on S where the envelope's rows reach 10 to 30 (frames of 6, paths of 150 to 1,000 frames with
// loops, one thread): at equal predicted flops the sparse factor took 2 to 25 times as long, 7 in the middle.
constexpr double kSparsePenalty = 7.0;

// Flops one could do in the time that the analysis takes for a block of S (1 to 2 microseconds).
constexpr double kAnalysisFlops = 3e4;
// Flops below which looking further would cost more than it saves.
constexpr double kCheap = 3e7;

double AnalysisPrice(const SymmetricBlockRows& S) {
  std::size_t blocks = 0;
  for (int i = 0; i < S.num_rows(); ++i) {
    blocks += S.row(i).size();
  }
  return kAnalysisFlops * static_cast<double>(blocks);
}

// What is done for later calls too, catching up with what the other solver did or reordering, counts half.
double PriceOf(const ResumedSolver::Plan& plan) {
  return plan.again + 0.5 * (plan.flops - plan.again);
}

}  // namespace

Status AutomaticSolver::Factorize(const SymmetricBlockRows& S, const double* damping, const char* held, const Change& change) {
  missed_by_sparse_.first_row = std::min(missed_by_sparse_.first_row, change.first_row);
  missed_by_sparse_.pattern |= change.pattern;
  Status status;
  if (SparseIsCheaper(S, resumed_.PlanFor(S, held, change))) {
    chosen_ = &sparse_;
    status = sparse_.Factorize(S, damping, held, missed_by_sparse_);
    missed_by_sparse_ = {S.num_rows(), nullptr, false};
  } else {
    chosen_ = &resumed_;
    status = resumed_.FactorizeAsPlanned(S, damping, held);
  }
  work_ = chosen_->work();
  return status;
}

// The analysis that the prediction takes is the one that the factorisation needs; it is risked where there is much to win.
bool AutomaticSolver::SparseIsCheaper(const SymmetricBlockRows& S, const ResumedSolver::Plan& plan) {
  const double resumed = PriceOf(plan);
  if (resumed <= kCheap) {
    return false;
  }
  if (missed_by_sparse_.pattern) {
    if (resumed <= 2.0 * AnalysisPrice(S) || !sparse_.Analyze(S).ok()) {
      return false;
    }
    missed_by_sparse_.pattern = false;
  }
  return kSparsePenalty * sparse_.PredictedFlops() < resumed;
}

Status AutomaticSolver::Solve(const double* b, const Rows& changed_b, const Truncation& truncation, double* x) {
  if (chosen_ != &resumed_) {
    resumed_.MissSolve(changed_b);
  }
  const Status status = chosen_->Solve(b, changed_b, truncation, x);
  work_ = chosen_->work();
  return status;
}

}  // namespace inceres::internal
