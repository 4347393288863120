#include "incremental/undamped_factor.h"

#include <algorithm>

namespace inceres::internal {

// L of S itself, without μ diag C (docs/algorithms.md, "From a live factor"): damping would lower
// the variances of weak directions. It follows S by a list of changed rows of its own, which fills
// whether or not anybody asks; a call takes it up and factors the cliques that it makes stale.

// Zero damping but for rows that count as constant, which have a 1 there, as ReducedMatrix has it:
// held ones, and those that no factor touches, each a row of the identity that is coupled to
// nothing.
void UndampedFactor::TakeUpRow(const IncrementalSchur& schur, int row) {
  const IncrementalSchur::Frame& frame = schur.frames()[row];
  const bool is_alone = frame.factors.empty() && frame.landmarks.empty();
  constant_[row] = frame.held || is_alone ? 1 : 0;
  sizes_[row] = frame.size;
  std::fill_n(diagonal_.begin() + schur.FrameOffset(row), frame.size,
              constant_[row] != 0 ? 1.0 : 0.0);
}

// Whether the rows that were taken up are where they were: none has gone, come back or got another
// size.
bool UndampedFactor::KeepsPacking(const IncrementalSchur& schur) const {
  return std::all_of(changed_.begin(), changed_.end(), [&](std::int32_t row) {
    return row >= static_cast<std::int32_t>(sizes_.size()) ||
           sizes_[row] == schur.frames()[row].size;
  });
}

Status UndampedFactor::Follow(IncrementalSchur* schur, int* num_factored) {
  schur->changes().TakeUninverted(&changed_);
  *num_factored = 0;
  if (!is_new_ && changed_.empty()) {
    return factored_;
  }
  // In a problem that grows the rows before the new ones stay where they are: what is done goes
  // with what has changed.
  const int num_rows = static_cast<int>(schur->frames().size());
  const bool keeps_packing = !is_new_ && KeepsPacking(*schur);
  sizes_.resize(num_rows, 0);
  constant_.resize(num_rows, 0);
  diagonal_.resize(schur->size(), 0.0);
  if (keeps_packing) {
    std::for_each(changed_.begin(), changed_.end(),
                  [&](std::int32_t row) { TakeUpRow(*schur, row); });
  } else {
    for (int row = 0; row < num_rows; ++row) {
      TakeUpRow(*schur, row);
    }
  }
  ReducedSolver::Rows changed{changed_.empty() ? schur->S().num_rows() : changed_.front(),
                              &changed_};
  // The list began with the solver, and the tree knows nothing of what was there before: all is
  // new.
  if (is_new_) {
    changed = {};
  }
  is_new_ = false;
  factored_ =
      tree_.Factorize(ReducedMatrix(schur->S(), diagonal_.data(), constant_.data()), changed);
  *num_factored = tree_.work().factored_rows;
  return factored_;
}

}  // namespace inceres::internal
