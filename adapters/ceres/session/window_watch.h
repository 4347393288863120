#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include <ceres/problem.h>

#include "adapters/ceres/read/introspection.h"

namespace inceres::internal {

/// Whether the problem is of a window's size: few blocks larger than a landmark, and not many
/// residual blocks. Such a one is solved exactly in little time, and its values may be about to be
/// made final by marginalization. Cost: a few map lookups inside Ceres a parameter block.
bool IsOfWindowSize(const ceres::Problem& problem);

/// Watches a living problem for marginalization: what a solve leaves undone in weak directions is
/// harmless while the next solve goes on, and becomes final where states are taken out and a prior
/// stands for what they knew.
///
/// A window has slid if, since the last look, a state was removed and a residual block has come
/// that touches states which were there before and nothing else, as a prior does. A state is a
/// block with more than four tangent unknowns, or any block where none has more. Another state may
/// have its memory, as where a window's states lie in an array: one counts as removed also where
/// it had several residual blocks with states alone, and none of them is left.
class WindowWatch {
 public:
  /// Solves in a row without a slide after which a problem of a window's size counts as one that
  /// only grows.
  static constexpr int kQuietSolves = 20;

  /// Looks at the problem as it is for this solve. True if the solve should be exact: the window
  /// slid, now or within the last kQuietSolves, or it is of a window's size and has not lived for
  /// as many solves.
  bool WantsExact(const ProblemView& view);

 private:
  bool HasSlid(const ProblemView& view, bool any_large);

  // Ascending but for bonds.
  struct Look {
    std::vector<const double*> states;
    // of residual blocks that touch states only: hashes of what they are
    std::vector<std::size_t> links;
    // each of these with each of its states
    std::vector<std::pair<const double*, std::size_t>> bonds;
  };
  Look last_;
  Look now_;
  int num_quiet_ = 0;
  bool slides_ = false;
  bool begun_ = false;
};

}  // namespace inceres::internal
