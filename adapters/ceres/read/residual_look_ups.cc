#include "adapters/ceres/read/residual_look_ups.h"

#include <algorithm>
#include <cstdint>

#include <ceres/cost_function.h>

#include "adapters/ceres/read/index.h"
#include "src/base/parallel_for.h"

namespace inceres::internal {
namespace {

constexpr int kGroup = 512;         // residual blocks a task
constexpr int kMost = 64 * kGroup;  // at a time: what is looked up is read while it is in the cache

}  // namespace

void ResidualLookUps::Take(const std::vector<ceres::ResidualBlockId>& ids, std::size_t first,
                           int num_threads) {
  const int count = static_cast<int>(std::min(At(kMost), ids.size() - first));
  const int num_groups = (count + kGroup - 1) / kGroup;
  found_.resize(At(count));
  groups_.resize(std::max(groups_.size(), At(num_groups)));
  ParallelFor(num_threads, num_groups, 1, [&](int begin, int end) {
    for (int group = begin; group < end; ++group) {
      LookUp(ids.data() + first, group * kGroup, std::min(count, (group + 1) * kGroup),
             &groups_[At(group)]);
    }
  });
}

void ResidualLookUps::LookUp(const ceres::ResidualBlockId* ids, int begin, int end, Group* group) {
  group->blocks.clear();
  int previous = 0;  // where the residual block before has its blocks
  for (int k = begin; k < end; ++k) {
    ResidualLookUp& residual = found_[At(k)];
    residual.cost = problem_.GetCostFunctionForResidualBlock(ids[k]);
    residual.loss = problem_.GetLossFunctionForResidualBlock(ids[k]);
    residual.num_residuals = residual.cost->num_residuals();
    problem_.GetParameterBlocksForResidualBlock(ids[k], &group->pointers);
    residual.num_slots = static_cast<int>(group->pointers.size());
    const std::vector<std::int32_t>& sizes = residual.cost->parameter_block_sizes();
    residual.sizes_fit = sizes.size() == group->pointers.size();
    const int first = static_cast<int>(group->blocks.size());
    for (std::size_t s = 0; s < group->pointers.size(); ++s) {
      const int b = FindBlock(*group, previous + static_cast<int>(s), first, group->pointers[s]);
      group->blocks.push_back(b);
      residual.sizes_fit = residual.sizes_fit && sizes[s] == view_.block(b).ambient_size;
    }
    previous = first;
  }
  // The list has stopped moving.
  const int* next = group->blocks.data();
  for (int k = begin; k < end; ++k) {
    found_[At(k)].blocks = next;
    next += found_[At(k)].num_slots;
  }
}

// Of a slot, where the residual block before often has the same.
int ResidualLookUps::FindBlock(const Group& group, int in_previous, int end_of_previous,
                               const double* pointer) const {
  if (in_previous < end_of_previous) {
    const int b = group.blocks[At(in_previous)];
    if (view_.block(b).values == pointer) {
      return b;
    }
  }
  return view_.index.Find(pointer);
}

}  // namespace inceres::internal
