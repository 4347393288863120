#pragma once

#include <vector>

#include <ceres/problem.h>

#include "adapters/ceres/read/index.h"
#include "adapters/ceres/read/introspection.h"
#include "src/base/aligned_vector.h"

namespace inceres::internal {

/// Looks up some residual blocks after the others, in groups. Their objects lie anywhere in memory,
/// so that most of the time goes by waiting for it, which several threads may do.
class ResidualLookUps {
 public:
  static constexpr int kGroup = 512;  ///< residual blocks in a group, if there are as many left

  /// The view has its parameter blocks, the ids of its residual blocks, and room for these.
  /// `slots`: of all residual blocks, which have been read (TouchedBlocks), or empty.
  ResidualLookUps(const ceres::Problem& problem, const UnwrittenVector<int>& slots,
                  ProblemView* view)
      : problem_(problem), known_slots_(slots), view_(*view) {}

  /// Fills in the residual blocks of some groups from `first` on, but for first_slot, which is into
  /// SlotsOf their group. Returns the number of these groups.
  int Take(int first, int num_threads);
  /// Of one of the groups that were taken last.
  const std::vector<int>& SlotsOf(int group) const { return view_.groups[At(group)].slots; }

 private:
  void LookUp(int begin, int end, ResidualGroup* group);

  const ceres::Problem& problem_;
  const UnwrittenVector<int>& known_slots_;
  ProblemView& view_;
};

}  // namespace inceres::internal
