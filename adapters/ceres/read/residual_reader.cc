#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <string>
#include <vector>

#include <ceres/cost_function.h>
#include <ceres/problem.h>

#include "adapters/ceres/read/index.h"
#include "adapters/ceres/read/introspection.h"
#include "adapters/ceres/read/touched_blocks.h"
#include "src/base/aligned_vector.h"
#include "src/base/executor.h"

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

// Looks residual blocks up in groups and reads these one after the other, in program order. Their
// objects lie anywhere in memory, so that most of the time goes by waiting for it: several threads
// look up at once.
class ResidualReader {
 public:
  ResidualReader(const ceres::Problem& problem, const TouchedBlocks& touched, ProblemView* view)
      : problem_(problem),
        known_slots_(touched.slots()),
        view_(*view),
        count_(static_cast<int>(view->ids.size())) {}

  void Run(int num_threads) {
    view_.residuals.resize(view_.ids.size());
    view_.moving.reserve(view_.ids.size());
    view_.slots.reserve(std::max(3 * view_.ids.size(), known_slots_.size()));
    while (next_ < count_) {
      const int num_groups = LookUpGroups(num_threads);
      for (int group = 0; group < num_groups; ++group) {
        ReadGroup(view_.groups[At(group)].slots);
      }
    }
    view_.all.num_residual_blocks = count_;
    view_.reduced.num_residual_blocks = static_cast<int>(view_.moving.size());
  }

 private:
  static constexpr int kGroup = 512;  // residual blocks in a group, if there are as many left

  // Fills in the residual blocks of some groups from next_ on, but for first_slot, which is into
  // the slots of their group. Returns the number of these groups.
  int LookUpGroups(int num_threads) {
    const int first = next_;
    const int num_left = count_ - first;
    // What is looked up is read while it is in the cache.
    const int num_groups = std::min(num_threads > 1 ? 64 : 1, (num_left + kGroup - 1) / kGroup);
    view_.groups.resize(std::max(view_.groups.size(), At(num_groups)));
    Executor(num_threads).For(num_groups, 1, [&](int group, int groups_end) {
      for (; group < groups_end; ++group) {
        const int begin = first + group * kGroup;
        LookUp(begin, std::min(begin + kGroup, first + num_left), &view_.groups[At(group)]);
      }
    });
    return num_groups;
  }

  void LookUp(int begin, int end, ResidualGroup* group) {
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

  // Run by run of residual blocks that are like the one before.
  void ReadGroup(const std::vector<int>& slots) {
    const int first_slot = static_cast<int>(view_.slots.size());
    view_.slots.insert(view_.slots.end(), slots.begin(), slots.end());
    ResidualBlockView* const residuals = view_.residuals.data();
    const int end = std::min(next_ + kGroup, count_);
    while (next_ < end) {
      ResidualBlockView& first = residuals[next_];
      first.first_slot += first_slot;
      if (!first.sound) {
        FindDefect(first);
      }
      int run_end = next_ + 1;
      for (; run_end < end && residuals[run_end].like_previous; ++run_end) {
        residuals[run_end].first_slot = first.first_slot;
      }
      view_.all.num_residuals += first.num_residuals * (run_end - next_);
      if (!first.fixed) {
        Move(first, run_end);
      }
      next_ = run_end;
    }
  }

  // Those from next_ on, all like this one.
  void Move(const ResidualBlockView& residual, int end) {
    const int count = end - next_;
    const std::size_t num_before = view_.moving.size();
    view_.moving.resize(num_before + At(count));
    std::iota(view_.moving.begin() + static_cast<std::ptrdiff_t>(num_before), view_.moving.end(),
              next_);
    view_.reduced.num_residuals += residual.num_residuals * count;
    const int* const slots = view_.SlotsOf(residual);
    for (int s = 0; s < residual.num_slots; ++s) {
      view_.blocks[At(slots[s])].degree += count;
    }
  }

  void FindDefect(const ResidualBlockView& residual) {
    // In program order, which is the order Ceres's own messages use.
    const std::string name = "residual block " + std::to_string(next_);
    const std::vector<std::int32_t>& sizes = residual.cost->parameter_block_sizes();
    const int* const slots = view_.SlotsOf(residual);
    if (sizes.size() != At(residual.num_slots)) {
      view_.SetDefect("the cost function of " + name +
                      " has changed its number of parameter blocks");
    }
    for (int s = 0; s < residual.num_slots; ++s) {
      if (std::find(slots, slots + s, slots[s]) != slots + s) {
        view_.SetDefect(Describe(view_.block(slots[s])) + " appears twice in " + name);
      }
    }
    for (std::size_t s = 0; s < std::min(sizes.size(), At(residual.num_slots)); ++s) {
      const ParameterBlockView& block = view_.block(slots[s]);
      if (sizes[s] != block.ambient_size) {
        view_.SetDefect("the cost function of " + name + " expects another size than that of " +
                        Describe(block));
      }
    }
    if (residual.num_residuals <= 0) {
      view_.SetDefect(name + " has no residuals");
    }
  }

  const ceres::Problem& problem_;
  const UnwrittenVector<int>& known_slots_;  // of all residual blocks, or none
  ProblemView& view_;
  const int count_;
  int next_ = 0;  // the residual block that is read
};

}  // namespace

void ReadResidualBlocks(const ceres::Problem& problem, const TouchedBlocks& touched,
                        int num_threads, ProblemView* view) {
  ResidualReader(problem, touched, view).Run(num_threads);
}

}  // namespace inceres::internal
