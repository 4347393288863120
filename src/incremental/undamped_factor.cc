#include "incremental/undamped_factor.h"

#include <algorithm>

namespace inceres::internal {

// L of S itself, without μ diag C (docs/algorithms.md, "From a live factor"): damping would lower
// the variances of weak directions. It follows S by a list of changed rows of its own, which fills
// whether or not anybody asks; a call takes it up and factors the cliques that it makes stale.

// A row that no factor touches is one of the identity, coupled to nothing.
Status UndampedFactor::Follow(IncrementalSchur* schur, int* num_factored) {
  schur->changes().TakeUninverted(&changed_);
  *num_factored = 0;
  if (!is_new_ && changed_.empty()) {
    return factored_;
  }
  // Zero damping but for rows that count as constant, which have a 1 there, as ReducedMatrix has
  // it.
  diagonal_.assign(schur->size(), 0.0);
  constant_.assign(schur->frames().size(), 0);
  for (std::size_t row = 0; row < schur->frames().size(); ++row) {
    const IncrementalSchur::Frame& frame = schur->frames()[row];
    const bool is_alone = frame.factors.empty() && frame.landmarks.empty();
    constant_[row] = frame.held || is_alone ? 1 : 0;
    if (constant_[row] != 0) {
      std::fill_n(diagonal_.begin() + schur->FrameOffset(static_cast<int>(row)), frame.size, 1.0);
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
