#include "adapters/ceres/session/window_watch.h"

#include <algorithm>
#include <functional>
#include <utility>

#include "adapters/ceres/read/index.h"

namespace inceres::internal {
namespace {

// Largest tangent size of what may be a landmark.
constexpr int kLandmarkSize = 4;

constexpr int kMaxStates = 100;
constexpr int kMaxResidualBlocks = 16384;

bool IsOfWindowSize(int num_residual_blocks, int num_blocks, int num_large) {
  return num_residual_blocks <= kMaxResidualBlocks &&
         (num_large > 0 ? num_large : num_blocks) <= kMaxStates;
}

void Mix(std::size_t* hash, std::size_t value) {
  *hash ^= value + 0x9e3779b97f4a7c15U + (*hash << 6) + (*hash >> 2);
}

// What of a residual block stays where a problem is built anew of the same cost functions.
std::size_t HashOf(const ProblemView& view, const ResidualBlockView& residual) {
  std::size_t hash = std::hash<const void*>()(residual.cost);
  for (int s = 0; s < residual.num_slots; ++s) {
    Mix(&hash, std::hash<const void*>()(view.block(view.SlotsOf(residual)[s]).values));
  }
  return hash;
}

// Whether a state is gone, though another may have its address: it had bonds, and none is there any
// more. One alone may have been replaced, as the odometry of the newest state. Sorts both.
template <typename Bonds>
bool AnyLostAll(Bonds* before, Bonds* now) {
  std::sort(before->begin(), before->end());
  std::sort(now->begin(), now->end());
  for (auto state = before->begin(); state != before->end();) {
    const auto end = std::find_if(state, before->end(),
                                  [state](const auto& bond) { return bond.first != state->first; });
    if (end - state > 1 && std::none_of(state, end, [now](const auto& bond) {
          return std::binary_search(now->begin(), now->end(), bond);
        })) {
      return true;
    }
    state = end;
  }
  return false;
}

}  // namespace

bool IsOfWindowSize(const ceres::Problem& problem) {
  if (problem.NumResidualBlocks() > kMaxResidualBlocks) {
    return false;
  }
  std::vector<double*> blocks;
  problem.GetParameterBlocks(&blocks);
  const auto num_large =
      std::count_if(blocks.begin(), blocks.end(), [&problem](const double* values) {
        return problem.ParameterBlockSize(values) > kLandmarkSize &&
               !problem.IsParameterBlockConstant(values);
      });
  return IsOfWindowSize(problem.NumResidualBlocks(), static_cast<int>(blocks.size()),
                        static_cast<int>(num_large));
}

bool WindowWatch::WantsExact(const ProblemView& view) {
  const auto num_large =
      std::count_if(view.blocks.begin(), view.blocks.end(), [](const ParameterBlockView& block) {
        return block.reduced() && block.tangent_size > kLandmarkSize;
      });
  const bool slid = HasSlid(view, num_large > 0);
  slides_ = begun_ && (slides_ || slid);
  num_quiet_ = slid || !begun_ ? 0 : num_quiet_ + 1;
  begun_ = true;
  if (num_quiet_ >= kQuietSolves) {
    slides_ = false;
    return false;
  }
  return slides_ || IsOfWindowSize(view.reduced.num_residual_blocks,
                                   view.reduced.num_parameter_blocks, static_cast<int>(num_large));
}

bool WindowWatch::HasSlid(const ProblemView& view, bool any_large) {
  const auto is_state = [any_large](const ParameterBlockView& block) {
    return block.reduced() && (!any_large || block.tangent_size > kLandmarkSize);
  };
  now_.states.clear();
  for (const ParameterBlockView& block : view.blocks) {
    if (is_state(block)) {
      now_.states.push_back(block.values);
    }
  }
  std::sort(now_.states.begin(), now_.states.end());
  now_.links.clear();
  now_.bonds.clear();
  bool has_new_link = false;
  for (const int r : view.moving) {
    const ResidualBlockView& residual = view.residuals[At(r)];
    const int* slots = view.SlotsOf(residual);
    if (!std::all_of(slots, slots + residual.num_slots,
                     [&](int b) { return is_state(view.block(b)); })) {
      continue;
    }
    const std::size_t bond = HashOf(view, residual);
    for (int s = 0; s < residual.num_slots; ++s) {
      now_.bonds.emplace_back(view.block(slots[s]).values, bond);
    }
    now_.links.push_back(bond);
    Mix(&now_.links.back(), std::hash<const void*>()(view.ids[At(r)]));
    const bool all_old = std::all_of(slots, slots + residual.num_slots, [&](int b) {
      return std::binary_search(last_.states.begin(), last_.states.end(), view.block(b).values);
    });
    has_new_link |=
        all_old && !std::binary_search(last_.links.begin(), last_.links.end(), now_.links.back());
  }
  std::sort(now_.links.begin(), now_.links.end());
  // Bonds are put in order where they decide alone: nothing new between old states is no slide.
  const bool has_slid = has_new_link && (!std::includes(now_.states.begin(), now_.states.end(),
                                                        last_.states.begin(), last_.states.end()) ||
                                         AnyLostAll(&last_.bonds, &now_.bonds));
  std::swap(last_, now_);
  return has_slid;
}

}  // namespace inceres::internal
