#pragma once

#include <vector>

#include <ceres/types.h>

#include "adapters/ceres/read/introspection.h"
#include "adapters/ceres/read/ordering.h"

namespace inceres::internal {

/// All that the plan of a graph depends on, in numbers: sizes of the blocks, blocks of the residual blocks, and landmarks the
/// user has named. Neither values nor anything of the user's.
class ProblemStructure {
 public:
  ProblemStructure(const ProblemView& view, const OrderingView& ordering, ceres::LinearSolverType type);

  /// Cost: linear in slots, without an allocation.
  bool IsThatOf(const ProblemView& view, const OrderingView& ordering, ceres::LinearSolverType type) const;

 private:
  struct Block {
    int ambient_size;
    int tangent_size;
    bool constant;
  };

  ceres::LinearSolverType type_;
  bool landmarks_are_given_;
  std::vector<int> first_group_;  // of landmarks that are given
  std::vector<Block> blocks_;     // by address, as in the view
  std::vector<ResidualBlockShape> residuals_;
  std::vector<int> slots_;
};

}  // namespace inceres::internal
