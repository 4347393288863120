#include "adapters/ceres/read/residual_look_ups.h"

#include <algorithm>
#include <cstdint>

#include <ceres/cost_function.h>

#include "src/base/parallel_for.h"

namespace inceres::internal {
namespace {

// What a residual block says of itself, and its slots to group->slots from `first` on, behind those
// of the one before. Whether it is sound but for blocks that are there twice.
bool Read(const ceres::Problem& problem, int r, int previous, int first, ProblemView* view,
          ResidualGroup* group) {
  const ParameterBlockView* const known = view->blocks.data();
  ResidualBlockView& residual = view->residuals[At(r)];
  const ceres::ResidualBlockId id = view->ids[At(r)];
  residual.cost = problem.GetCostFunctionForResidualBlock(id);
  residual.loss = problem.GetLossFunctionForResidualBlock(id);
  residual.num_residuals = residual.cost->num_residuals();
  problem.GetParameterBlocksForResidualBlock(id, &group->pointers);
  double* const* const pointers = group->pointers.data();
  const int num_slots = static_cast<int>(group->pointers.size());
  const int num_near = first - previous;
  residual.num_slots = num_slots;
  int* const blocks = group->MakeRoom(first, num_slots);
  const int* const near = group->slots.data() + previous;
  const std::vector<std::int32_t>& sizes = residual.cost->parameter_block_sizes();
  bool sound = sizes.size() == At(num_slots) && residual.num_residuals > 0;
  for (int s = 0; s < num_slots; ++s) {
    // The slot of the residual block before often has the same.
    const bool is_near = s < num_near && known[near[s]].values == pointers[s];
    const int b = is_near ? near[s] : view->index.Find(pointers[s]);
    blocks[s] = b;
    sound = sound && sizes[At(s)] == known[b].ambient_size;
  }
  return sound;
}

bool AreDistinct(const int* blocks, int count, std::vector<int>* sorted) {
  constexpr int kMany = 8;
  if (count > kMany) {
    sorted->assign(blocks, blocks + count);
    std::sort(sorted->begin(), sorted->end());
    return std::adjacent_find(sorted->begin(), sorted->end()) == sorted->end();
  }
  for (int s = 1; s < count; ++s) {
    for (int t = 0; t < s; ++t) {
      if (blocks[s] == blocks[t]) {
        return false;
      }
    }
  }
  return true;
}

}  // namespace

int ResidualLookUps::Take(int first, int num_threads) {
  const int num_left = static_cast<int>(view_.ids.size()) - first;
  // What is looked up is read while it is in the cache.
  const int num_groups = std::min(num_threads > 1 ? 64 : 1, (num_left + kGroup - 1) / kGroup);
  groups_.resize(std::max(groups_.size(), At(num_groups)));
  ParallelFor(num_threads, num_groups, 1, [&](int group, int groups_end) {
    for (; group < groups_end; ++group) {
      const int begin = first + group * kGroup;
      LookUp(begin, std::min(begin + kGroup, first + num_left), &groups_[At(group)]);
    }
  });
  return num_groups;
}

void ResidualLookUps::LookUp(int begin, int end, ResidualGroup* group) {
  const ParameterBlockView* const known = view_.blocks.data();
  int first = 0;     // where this residual block has its slots, unless it shares those
  int previous = 0;  // of the one before
  for (int r = begin; r < end; ++r) {
    ResidualBlockView& residual = view_.residuals[At(r)];
    if (known_slots_.empty()) {
      residual.sound = Read(problem_, r, previous, first, &view_, group);
    } else {
      std::copy_n(known_slots_.data() + residual.first_slot, residual.num_slots,
                  group->MakeRoom(first, residual.num_slots));
    }
    const bool sound = residual.sound;
    const int* const blocks = group->slots.data() + first;
    const int* const near = group->slots.data() + previous;
    const int num_slots = residual.num_slots;
    bool repeats = sound && num_slots == first - previous;
    bool fixed = true;
    for (int s = 0; s < num_slots; ++s) {
      repeats = repeats && blocks[s] == near[s];
      fixed = fixed && known[blocks[s]].constant;
    }
    residual.sound = repeats || (sound && AreDistinct(blocks, num_slots, &group->sorted));
    residual.fixed = fixed;
    residual.like_previous =
        repeats && r > begin && residual.num_residuals == view_.residuals[At(r - 1)].num_residuals;
    if (!repeats) {
      previous = first;
      first += num_slots;
    }
    residual.first_slot = previous;
  }
  group->slots.resize(At(first));
}

}  // namespace inceres::internal
