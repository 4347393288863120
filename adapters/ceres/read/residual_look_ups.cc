#include "adapters/ceres/read/residual_look_ups.h"

#include <algorithm>
#include <cstdint>

#include <ceres/cost_function.h>

#include "src/base/parallel_for.h"

namespace inceres::internal {
namespace {

// What a residual block says of itself.
void Ask(const ceres::Problem& problem, ceres::ResidualBlockId id, ResidualBlockView* residual,
         std::vector<double*>* pointers) {
  residual->cost = problem.GetCostFunctionForResidualBlock(id);
  residual->loss = problem.GetLossFunctionForResidualBlock(id);
  residual->num_residuals = residual->cost->num_residuals();
  problem.GetParameterBlocksForResidualBlock(id, pointers);
  residual->num_slots = static_cast<int>(pointers->size());
}

// A handful, mostly of one or two: no call for them.
template <typename T>
bool AreEqual(const std::vector<T>& a, const std::vector<T>& b) {
  const std::size_t size = a.size();
  if (b.size() != size) {
    return false;
  }
  for (std::size_t k = 0; k < size; ++k) {
    if (a[k] != b[k]) {
      return false;
    }
  }
  return true;
}

// Another residual block of the same blocks, as in curve fitting: all else is known.
bool Repeats(const ResidualBlockView& before, const ResidualGroup& group,
             const ResidualBlockView& residual) {
  return before.sound && residual.num_residuals == before.num_residuals &&
         AreEqual(group.pointers, group.pointers_before) &&
         AreEqual(residual.cost->parameter_block_sizes(), before.cost->parameter_block_sizes());
}

// Its slots to group->slots from `first` on, behind those of the one before. Whether it is sound
// but for blocks that are there twice.
bool FindSlots(const ProblemView& view, const ResidualBlockView& residual, int previous, int first,
               ResidualGroup* group) {
  const ParameterBlockView* const known = view.blocks.data();
  double* const* const pointers = group->pointers.data();
  const int num_near = first - previous;
  int* const blocks = group->MakeRoom(first, residual.num_slots);
  const int* const near = group->slots.data() + previous;
  const std::vector<std::int32_t>& sizes = residual.cost->parameter_block_sizes();
  bool sound = sizes.size() == At(residual.num_slots) && residual.num_residuals > 0;
  for (int s = 0; s < residual.num_slots; ++s) {
    // The slot of the residual block before often has the same.
    const bool is_near = s < num_near && known[near[s]].values == pointers[s];
    const int b = is_near ? near[s] : view.index.Find(pointers[s]);
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
  view_.groups.resize(std::max(view_.groups.size(), At(num_groups)));
  ParallelFor(num_threads, num_groups, 1, [&](int group, int groups_end) {
    for (; group < groups_end; ++group) {
      const int begin = first + group * kGroup;
      LookUp(begin, std::min(begin + kGroup, first + num_left), &view_.groups[At(group)]);
    }
  });
  return num_groups;
}

void ResidualLookUps::LookUp(int begin, int end, ResidualGroup* group) {
  // Calls into Ceres may change any member, for all the compiler knows.
  const ceres::Problem& problem = problem_;
  const ceres::ResidualBlockId* const ids = view_.ids.data();
  const ParameterBlockView* const known = view_.blocks.data();
  ResidualBlockView* const residuals = view_.residuals.data();
  const int* const known_slots = known_slots_.empty() ? nullptr : known_slots_.data();
  int first = 0;     // where this residual block has its slots, unless it shares those
  int previous = 0;  // of the one before
  for (int r = begin; r < end; ++r) {
    ResidualBlockView& residual = residuals[r];
    if (known_slots == nullptr) {
      Ask(problem, ids[r], &residual, &group->pointers);
      if (r > begin && Repeats(residuals[r - 1], *group, residual)) {
        const ResidualBlockView& before = residuals[r - 1];
        residual.first_slot = before.first_slot;
        residual.fixed = before.fixed;
        residual.sound = residual.like_previous = true;
        continue;
      }
      residual.sound = FindSlots(view_, residual, previous, first, group);
      group->pointers.swap(group->pointers_before);
    } else {
      std::copy_n(known_slots + residual.first_slot, residual.num_slots,
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
        repeats && r > begin && residual.num_residuals == residuals[r - 1].num_residuals;
    if (!repeats) {
      previous = first;
      first += num_slots;
    }
    residual.first_slot = previous;
  }
  group->slots.resize(At(first));
}

}  // namespace inceres::internal
