#pragma once

#include <cstddef>
#include <vector>

#include <ceres/problem.h>

#include "adapters/ceres/read/index.h"
#include "adapters/ceres/read/introspection.h"

namespace inceres::internal {

/// Looks up some residual blocks after the others. Their objects lie anywhere in memory, so that
/// most of the time goes by waiting for it, which several threads may do.
class ResidualLookUps {
 public:
  /// The view has its parameter blocks and room for the residual blocks, whose ids it has.
  ResidualLookUps(const ceres::Problem& problem, ProblemView* view)
      : problem_(problem), view_(*view) {}

  /// Fills in some residual blocks from `first` on, all but like_previous and the final
  /// first_slot. Returns the end of these.
  int Take(int first, int num_threads);
  /// The blocks of one of these, by their index in the view, until its first_slot is final.
  const int* BlocksOf(int residual) const {
    return groups_[At(residual - first_) / At(kGroup)].blocks.data() +
           view_.residuals[At(residual)].first_slot;
  }

 private:
  static constexpr int kGroup = 512;  // residual blocks a task

  struct Group {
    std::vector<double*> pointers;  // of one residual block
    std::vector<int> blocks;        // of all slots of the group
  };

  void LookUp(int begin, int end, Group* group);

  const ceres::Problem& problem_;
  ProblemView& view_;
  int first_ = 0;
  std::vector<Group> groups_;
};

}  // namespace inceres::internal
