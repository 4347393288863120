#include "linear/automatic_solver.h"

#include <algorithm>
#include <limits>

namespace inceres::internal {
namespace {

// CHOLMOD reaches 1 to 5 GFlop/s on S where the envelope's rows reach 10 to 30 (frames of 6, paths of 150 to 1,000 frames with
// loops, one thread): at equal predicted flops the sparse factor took 2 to 25 times as long, 7 in the middle.
constexpr double kSparsePenalty = 7.0;
// Flops one could do in the time that the analysis takes for a block of S (1 to 2 microseconds).
constexpr double kAnalysisFlops = 3e4;
// Catching up with what the other did counts this much: the factor serves later calls too.
constexpr double kCatchingUpShare = 0.5;
// Flops below which looking further would cost more than it saves.
constexpr double kCheap = 3e7;

double AnalysisPrice(const SymmetricBlockRows& S) {
  std::size_t blocks = 0;
  for (int i = 0; i < S.num_rows(); ++i) {
    blocks += S.row(i).size();
  }
  return kAnalysisFlops * static_cast<double>(blocks);
}

}  // namespace

Status AutomaticSolver::Factorize(const SymmetricBlockRows& S, const double* damping, const char* held, const Change& change) {
  for (Missed* missed : {&missed_by_resumed_, &missed_by_sparse_}) {
    missed->change.first_row = std::min(missed->change.first_row, change.first_row);
    missed->change.pattern |= change.pattern;
  }
  if (SparseIsCheaper(S, held, change)) {
    chosen_ = &sparse_;
  } else {
    chosen_ = &resumed_;
  }
  Change& missed = MissedBy(chosen_).change;
  const Status status = chosen_->Factorize(S, damping, held, missed);
  missed = {S.num_rows(), nullptr, false};
  work_ = chosen_->work();
  return status;
}

// The analysis that the prediction takes is the one that the factorisation needs; it is risked where there is much to win.
bool AutomaticSolver::SparseIsCheaper(const SymmetricBlockRows& S, const char* held, const Change& change) {
  const double resumed = ResumedPrice(S, held, change);
  if (resumed <= kCheap) {
    return false;
  }
  if (missed_by_sparse_.change.pattern) {
    if (resumed <= 2.0 * AnalysisPrice(S) || !sparse_.Analyze(S).ok()) {
      return false;
    }
    missed_by_sparse_.change.pattern = false;
  }
  return kSparsePenalty * sparse_.PredictedFlops() < resumed;
}

double AutomaticSolver::ResumedPrice(const SymmetricBlockRows& S, const char* held, const Change& change) {
  const double all = resumed_.PredictFlops(S, held, missed_by_resumed_.change);
  const double now = missed_by_resumed_.change.first_row == change.first_row
                         ? all
                         : std::min(all, EnvelopeFlops(S, held, std::min(change.first_row, S.num_rows()), &workspace_));
  return now + kCatchingUpShare * (all - now);
}

Status AutomaticSolver::Solve(const double* b, int first_changed_b, const Truncation& truncation, double* x) {
  for (Missed* missed : {&missed_by_resumed_, &missed_by_sparse_}) {
    missed->first_b = std::min(missed->first_b, first_changed_b);
  }
  if (chosen_ != solved_last_) {
    resumed_.ForgetSolution();
  }
  Missed& missed = MissedBy(chosen_);
  const Status status = chosen_->Solve(b, missed.first_b, truncation, x);
  if (status.ok()) {
    missed.first_b = std::numeric_limits<int>::max();
    solved_last_ = chosen_;
  }
  work_ = chosen_->work();
  return status;
}

}  // namespace inceres::internal
