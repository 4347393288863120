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
  int first = 0;     // where this residual block has its blocks
  int previous = 0;  // and the one before
  for (int k = begin; k < end; ++k) {
    ResidualLookUp& residual = found_[At(k)];
    residual.cost = problem_.GetCostFunctionForResidualBlock(ids[k]);
    residual.loss = problem_.GetLossFunctionForResidualBlock(ids[k]);
    residual.num_residuals = residual.cost->num_residuals();
    problem_.GetParameterBlocksForResidualBlock(ids[k], &group->pointers);
    residual.num_slots = static_cast<int>(group->pointers.size());
    const std::vector<std::int32_t>& sizes = residual.cost->parameter_block_sizes();
    residual.sizes_fit = sizes.size() == group->pointers.size();
    if (group->blocks.size() < At(first + residual.num_slots)) {
      group->blocks.resize(2 * At(first + residual.num_slots));
    }
    int* const blocks = group->blocks.data();
    bool sizes_fit = residual.sizes_fit;
    for (int s = 0; s < residual.num_slots; ++s) {
      const double* const pointer = group->pointers[At(s)];
      // The slot of the residual block before often has the same.
      const int near = previous + s < first ? blocks[previous + s] : -1;
      const int b =
          near >= 0 && view_.block(near).values == pointer ? near : view_.index.Find(pointer);
      blocks[first + s] = b;
      sizes_fit = sizes_fit && sizes[At(s)] == view_.block(b).ambient_size;
    }
    residual.sizes_fit = sizes_fit;
    previous = first;
    first += residual.num_slots;
  }
  // The list has stopped moving.
  const int* next = group->blocks.data();
  for (int k = begin; k < end; ++k) {
    found_[At(k)].blocks = next;
    next += found_[At(k)].num_slots;
  }
}

}  // namespace inceres::internal
