#include "incremental/undamped_factor.h"

#include <algorithm>
#include <iterator>

#include "linear/not_positive_definite.h"

namespace inceres::internal {

// L of S itself, without μ diag C (docs/algorithms.md, "From a live factor"): damping would lower
// the variances of weak directions. It follows S by a list of changed rows of its own, which fills
// whether or not anybody asks; a call takes it up and factors the cliques that it makes stale, but
// for a few rows that may wait: a pose along the odometry, a loop that moves nothing.

namespace {

// Counts as constant: held ones, and those that no factor touches.
bool IsLeftOut(const IncrementalSchur::Frame& frame) {
  return frame.held || (frame.factors.empty() && frame.landmarks.empty());
}

}  // namespace

// Zero damping but for rows that count as constant, which have a 1 there, as ReducedMatrix has it:
// each a row of the identity that is coupled to nothing.
void UndampedFactor::TakeUpRow(const IncrementalSchur& schur, int row) {
  const IncrementalSchur::Frame& frame = schur.frames()[row];
  constant_[row] = IsLeftOut(frame) ? 1 : 0;
  sizes_[row] = frame.size;
  std::fill_n(diagonal_.begin() + schur.FrameOffset(row), frame.size,
              constant_[row] != 0 ? 1.0 : 0.0);
}

// Whether the rows that were taken up are where they were: none has gone, come back or got another
// size.
bool UndampedFactor::KeepsPacking(const IncrementalSchur& schur) const {
  return std::all_of(waiting_.begin(), waiting_.end(), [&](std::int32_t row) {
    return row >= static_cast<std::int32_t>(sizes_.size()) ||
           sizes_[row] == schur.frames()[row].size;
  });
}

// Whether products may find their way around what has changed. Held rows have other blocks in the
// factor than in S.
bool UndampedFactor::MayWait(const IncrementalSchur& schur) {
  return !is_new_ && factored_.ok() && num_released_ == schur.S().num_released() &&
         std::none_of(
             waiting_.begin(), waiting_.end(),
             [&](std::int32_t row) {
               return IsLeftOut(schur.frames()[row]) ||
                      (row < static_cast<std::int32_t>(constant_.size()) && constant_[row] != 0);
             }) &&
         pending_.TakeUp(schur.S(), tree_, waiting_);
}

void UndampedFactor::NoteChanges(IncrementalSchur* schur) {
  schur->changes().TakeUninverted(&scratch_);
  if (scratch_.empty()) {
    return;
  }
  changed_.swap(scratch_);
  scratch_.clear();
  std::set_union(waiting_.begin(), waiting_.end(), changed_.begin(), changed_.end(),
                 std::back_inserter(scratch_));
  waiting_.swap(scratch_);
  is_taken_up_ = false;
  if (std::any_of(changed_.begin(), changed_.end(),
                  [&](std::int32_t row) { return IsLeftOut(schur->frames()[row]); })) {
    tip_.Forget();
  }
  tip_.Follow(schur->S(), changed_);
}

// Of what has just changed the row that came last is the one that the next is likely to be coupled
// to.
void UndampedFactor::Remember(const IncrementalSchur& schur, int row,
                              const Eigen::MatrixXd& marginal) {
  if (!changed_.empty() && changed_.back() == row) {
    tip_.Set(schur.S(), row, marginal);
  }
}

Status UndampedFactor::Follow(const IncrementalSchur& schur, bool whole, int* num_factored) {
  *num_factored = 0;
  if (!is_new_ && (waiting_.empty() || (!whole && (is_taken_up_ || MayWait(schur))))) {
    is_taken_up_ = true;
    return factored_;
  }
  factored_ = Factorize(schur);
  is_taken_up_ = true;
  *num_factored = tree_.work().factored_rows;
  return factored_;
}

Status UndampedFactor::Factorize(const IncrementalSchur& schur) {
  // In a problem that grows the rows before the new ones stay where they are: what is done goes
  // with what has changed.
  const int num_rows = static_cast<int>(schur.frames().size());
  const bool keeps_packing = !is_new_ && KeepsPacking(schur);
  sizes_.resize(num_rows, 0);
  constant_.resize(num_rows, 0);
  diagonal_.resize(schur.size(), 0.0);
  if (keeps_packing) {
    std::for_each(waiting_.begin(), waiting_.end(),
                  [&](std::int32_t row) { TakeUpRow(schur, row); });
  } else {
    for (int row = 0; row < num_rows; ++row) {
      TakeUpRow(schur, row);
    }
  }
  // The list began with the solver, and the tree knows nothing of what was there before: all is
  // new.
  ReducedSolver::Rows changed;
  if (!is_new_) {
    changed = {waiting_.empty() ? schur.S().num_rows() : waiting_.front(), &waiting_};
  }
  is_new_ = false;
  num_released_ = schur.S().num_released();
  const Status factored = NameVariable(
      tree_, tree_.Factorize(ReducedMatrix(schur.S(), diagonal_.data(), constant_.data()), changed),
      [&schur](std::size_t row) { return schur.frames()[row].id; });
  waiting_.clear();
  pending_.Forget();
  return factored;
}

}  // namespace inceres::internal
