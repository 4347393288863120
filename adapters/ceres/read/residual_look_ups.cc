#include "adapters/ceres/read/residual_look_ups.h"

#include <algorithm>
#include <cstdint>

#include <ceres/cost_function.h>

#include "src/base/parallel_for.h"

namespace inceres::internal {

int ResidualLookUps::Take(int first, int num_threads) {
  // What is looked up is read while it is in the cache.
  const int most = num_threads > 1 ? 64 * kGroup : kGroup;
  const int end = first + std::min(most, static_cast<int>(view_.ids.size()) - first);
  const int num_groups = (end - first + kGroup - 1) / kGroup;
  first_ = first;
  groups_.resize(std::max(groups_.size(), At(num_groups)));
  ParallelFor(num_threads, num_groups, 1, [&](int group, int groups_end) {
    for (; group < groups_end; ++group) {
      const int begin = first + group * kGroup;
      LookUp(begin, std::min(end, begin + kGroup), &groups_[At(group)]);
    }
  });
  return end;
}

void ResidualLookUps::LookUp(int begin, int end, Group* group) {
  const ParameterBlockView* const known = view_.blocks.data();
  int first = 0;     // where this residual block has its blocks
  int previous = 0;  // and the one before
  for (int r = begin; r < end; ++r) {
    const ceres::ResidualBlockId id = view_.ids[At(r)];
    ResidualBlockView& residual = view_.residuals[At(r)];
    residual.cost = problem_.GetCostFunctionForResidualBlock(id);
    residual.loss = problem_.GetLossFunctionForResidualBlock(id);
    residual.num_residuals = residual.cost->num_residuals();
    problem_.GetParameterBlocksForResidualBlock(id, &group->pointers);
    const int num_slots = static_cast<int>(group->pointers.size());
    if (group->blocks.size() < At(first + num_slots)) {
      group->blocks.resize(2 * At(first + num_slots));
    }
    int* const blocks = group->blocks.data() + first;
    // The slot of the residual block before often has the same.
    const int* const near = group->blocks.data() + previous;
    const int num_near = first - previous;
    const std::vector<std::int32_t>& sizes = residual.cost->parameter_block_sizes();
    bool sizes_fit = sizes.size() == group->pointers.size();
    bool fixed = true;
    for (int s = 0; s < num_slots; ++s) {
      const double* const pointer = group->pointers[At(s)];
      const bool is_near = s < num_near && known[near[s]].values == pointer;
      const int b = is_near ? near[s] : view_.index.Find(pointer);
      blocks[s] = b;
      sizes_fit = sizes_fit && sizes[At(s)] == known[b].ambient_size;
      fixed = fixed && known[b].constant;
    }
    residual.sizes_fit = sizes_fit;
    residual.fixed = fixed;
    residual.num_slots = num_slots;
    residual.first_slot = first;
    previous = first;
    first += num_slots;
  }
}

}  // namespace inceres::internal
