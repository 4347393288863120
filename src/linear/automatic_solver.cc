#include "linear/automatic_solver.h"

#include <algorithm>
#include <cstddef>
#include <utility>

namespace inceres::internal {

// The incremental choice of docs/algorithms.md, "Reduced linear systems": each factorization goes
// to the resumed envelope factor or to the Bayes tree, by predicted flops. Both predictions count
// operations of the structure and never ask the clock, so the choice is the same in every run.
//
// Two states follow the edits. The tree notes every changed row (Follow) and takes them up when it
// plans; the resumed factor notes from which row on it is out of date (MissFactorize). While the
// tree works, saving_ sums up what a resumed factor that had kept up would have spared; once that
// pays for catching up, it catches up. This is the ski-rental rule: the sum of rents never exceeds
// the price by more than the price, so the total is at most twice that of one who knew the future.
// The other way round, regret_ sums up by how much resumed factorizations exceed all of the tree,
// and pays for looking at the tree again.

namespace {

// At equal predicted flops the tree takes this much longer: its fronts run at 14 to 25 GFlop/s
// where the envelope's long rows reach 10 to 30.
constexpr double kTreePenalty = 1.5;
// Flops that one could do in the time that a clique takes beside its own.
constexpr double kCliqueFlops = 5e3;
// Flops one could do in the time that the tree takes to take up what has changed, for each block of
// S: much less than ordering all of it.
constexpr double kTakeUpFlops = 2e3;
// Flops below which looking further would cost more than it saves.
constexpr double kCheap = 1e5;
// Each time a resumed factor would have taken more it is asked half as often; for how many
// factorizations at most it is not asked, and the same where it would take so many times the tree's
// cost, had it kept up.
constexpr int kShortPause = 7;
constexpr double kFarDearer = 4.0;
constexpr int kLongestPause = 64;

// What the tree would need to take up all of S, in flops.
double TakeUpPrice(const SymmetricBlockRows& S) {
  std::size_t blocks = 0;
  for (int i = 0; i < S.num_rows(); ++i) {
    blocks += S.row(i).size();
  }
  return kTakeUpFlops * static_cast<double>(blocks);
}

}  // namespace

Status AutomaticSolver::Factorize(const ReducedMatrix& A, const Rows& changed) {
  tree_.Follow(*A.rows(), changed);
  Status status;
  // Both have planned by now, or know that they need not: the second half of the work follows.
  if (TreeIsCheaper(A, changed)) {
    chosen_ = &tree_;
    status = tree_.FactorizeAsPlanned(A);
  } else {
    chosen_ = &resumed_;
    // The resumed factor is up to date after this: the next absence is counted from zero.
    saving_ = 0.0;
    num_unseen_ = 0;
    status = resumed_.FactorizeAsPlanned(A);
  }
  work_ = chosen_->work();
  return status;
}

bool AutomaticSolver::TreeIsCheaper(const ReducedMatrix& A, const Rows& changed) {
  // A tree that cannot plan, for want of memory, has not taken up what has changed.
  const bool tree_is_behind = chosen_ == &tree_ && !PlanTree(A);
  if (chosen_ == &tree_ && !tree_is_behind && (tree_flops_ <= kCheap || num_unasked_ > 0)) {
    // The tree is cheap by itself, or the resumed factor was dearer not long ago: it is not even
    // asked for its prediction, which costs a pass over its envelope.
    num_unasked_ = std::max(0, num_unasked_ - 1);
    ++num_unseen_;
    resumed_.MissFactorize(changed);
    return true;
  }
  // What the resumed factor takes beyond the same change done twice, plan.cost - plan.again, is
  // the price of its absence. The savings so far are set against it.
  const ResumedSolver::Plan plan = resumed_.PlanFor(A, changed);
  const double resumed = plan.again + std::max(0.0, plan.cost - plan.again - saving_);
  if (tree_is_behind || resumed <= kCheap || !LooksAtTree(A, resumed)) {
    return false;
  }
  // The resumed factor wins: from now on it is asked each time again.
  if (tree_flops_ >= resumed) {
    pause_ = 0;
    return false;
  }
  // as of those for which it was not asked
  saving_ += (1 + std::exchange(num_unseen_, 0)) * std::max(0.0, tree_flops_ - plan.again);
  pause_ =
      std::min(2 * pause_ + 1, plan.again > kFarDearer * tree_flops_ ? kLongestPause : kShortPause);
  // Each refusal in a row doubles the pause, 1, 3, 7, …, up to a limit that is higher the further
  // the resumed factor is behind.
  num_unasked_ = pause_;
  return true;
}

// False if it is of no use.
bool AutomaticSolver::PlanTree(const ReducedMatrix& A) {
  if (!tree_.PlanFor(A).ok()) {
    return false;
  }
  // A stale clique costs something of its own, however small its front is.
  tree_flops_ = kTreePenalty * tree_.PredictedFlops() + kCliqueFlops * tree_.NumStale();
  return true;
}

// The tree has kept up if it was chosen last. Otherwise factorizations may take more than all of it
// would, as it was when it was last looked at, until that makes up for looking at it again.
bool AutomaticSolver::LooksAtTree(const ReducedMatrix& A, double resumed) {
  if (chosen_ == &tree_) {
    return true;
  }
  // The flops of all of the tree, as it was last known: the most that a factorization by it takes.
  regret_ += std::max(0.0, resumed - kTreePenalty * tree_.tree().flops());
  if (regret_ <= TakeUpPrice(*A.rows())) {
    return false;
  }
  regret_ = 0.0;
  return PlanTree(A);
}

// The one that was not chosen.
void AutomaticSolver::MissSolve(const Rows& changed_b) {
  if (chosen_ == &tree_) {
    resumed_.MissSolve(changed_b);
  } else {
    tree_.MissSolve(changed_b);
  }
}

Status AutomaticSolver::SolveForGain(const double* b, const Rows& changed_b, double* gain) {
  // The solver that was not chosen has to know that b has changed and that x is no longer its own.
  MissSolve(changed_b);
  const Status status = chosen_ == &tree_ ? tree_.SolveForGain(b, changed_b, gain)
                                          : resumed_.SolveForGain(b, changed_b, gain);
  work_ = chosen_->work();
  return status;
}

Status AutomaticSolver::Solve(const double* b, const Rows& changed_b, const Truncation& truncation,
                              double* x) {
  MissSolve(changed_b);
  const Status status = chosen_->Solve(b, changed_b, truncation, x);
  work_ = chosen_->work();
  return status;
}

}  // namespace inceres::internal
