#include "linear/automatic_solver.h"

#include <algorithm>

namespace inceres::internal {
namespace {

// At equal predicted flops the sparse factor takes this much longer: 14 to 25 GFlop/s where the
// envelope's long rows reach 10 to 30.
constexpr double kSparsePenalty = 1.5;

// Flops one could do in the time that the analysis takes for a block of S (half a microsecond).
constexpr double kAnalysisFlops = 1e4;
// Flops below which looking further would cost more than it saves.
constexpr double kCheap = 1e5;

double AnalysisPrice(const SymmetricBlockRows& S) {
  std::size_t blocks = 0;
  for (int i = 0; i < S.num_rows(); ++i) {
    blocks += S.row(i).size();
  }
  return kAnalysisFlops * static_cast<double>(blocks);
}

}  // namespace

Status AutomaticSolver::Factorize(const ReducedMatrix& A, const Rows& changed) {
  Status status;
  const ResumedSolver::Plan plan = resumed_.PlanFor(A, changed);
  if (SparseIsCheaper(A, plan)) {
    chosen_ = &sparse_;
    saving_ += std::max(0.0, kSparsePenalty * sparse_.PredictedFlops() - plan.again);
    status = sparse_.Factorize(A, {});
  } else {
    chosen_ = &resumed_;
    saving_ = 0.0;
    status = resumed_.FactorizeAsPlanned(A);
  }
  work_ = chosen_->work();
  return status;
}

// The pattern is analyzed once the resumed factorizations since the last analysis have cost more
// than those of the last known sparse factor by what an analysis takes: at most twice what it would
// be for who knew what is to come.
bool AutomaticSolver::SparseIsCheaper(const ReducedMatrix& A, const ResumedSolver::Plan& plan) {
  const double resumed = plan.again + std::max(0.0, plan.flops - plan.again - saving_);
  if (resumed <= kCheap) {
    return false;
  }
  regret_ += std::max(0.0, resumed - kSparsePenalty * sparse_flops_);
  if (regret_ <= AnalysisPrice(*A.rows()) || !sparse_.Analyze(A).ok()) {
    return false;
  }
  regret_ = 0.0;
  sparse_flops_ = sparse_.PredictedFlops();
  return kSparsePenalty * sparse_flops_ < resumed;
}

Status AutomaticSolver::Solve(const double* b, const Rows& changed_b, const Truncation& truncation,
                              double* x) {
  if (chosen_ != &resumed_) {
    resumed_.MissSolve(changed_b);
  }
  const Status status = chosen_->Solve(b, changed_b, truncation, x);
  work_ = chosen_->work();
  return status;
}

}  // namespace inceres::internal
