#pragma once

#include <cstddef>
#include <vector>

#include <ceres/problem.h>

#include "adapters/ceres/read/introspection.h"

namespace inceres::internal {

/// What Ceres says of a residual block.
struct ResidualLookUp {
  const ceres::CostFunction* cost = nullptr;
  const ceres::LossFunction* loss = nullptr;
  int num_residuals = 0;
  int num_slots = 0;
  bool sizes_fit = false;       ///< the cost function's are those of the blocks
  const int* blocks = nullptr;  ///< of the slots, by their index in the view
};

/// Looks up some residual blocks after the others. Their objects lie anywhere in memory, so that
/// most of the time goes by waiting for it, which several threads may do.
class ResidualLookUps {
 public:
  /// The view has its parameter blocks.
  ResidualLookUps(const ceres::Problem& problem, const ProblemView& view)
      : problem_(problem), view_(view) {}

  /// Replaces what it had by those of the residual blocks from `first` on.
  void Take(const std::vector<ceres::ResidualBlockId>& ids, std::size_t first, int num_threads);
  const std::vector<ResidualLookUp>& found() const { return found_; }

 private:
  struct Group {
    std::vector<double*> pointers;  // of one residual block
    std::vector<int> blocks;        // of all slots of the group
  };

  void LookUp(const ceres::ResidualBlockId* ids, int begin, int end, Group* group);

  const ceres::Problem& problem_;
  const ProblemView& view_;
  std::vector<ResidualLookUp> found_;
  std::vector<Group> groups_;
};

}  // namespace inceres::internal
