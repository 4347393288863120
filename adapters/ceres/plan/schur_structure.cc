#include "adapters/ceres/plan/schur_structure.h"

#include <algorithm>
#include <array>

#include "adapters/ceres/read/ceres_version.h"

namespace inceres::internal {
namespace {

constexpr int kDynamic = -1;
using Sizes = std::array<int, 3>;  // residual, landmark, frame

// Merges one more size into what was seen so far (0: nothing yet).
void Merge(int size, int* seen) {
  if (*seen == 0) {
    *seen = size;
  } else if (*seen != size) {
    *seen = kDynamic;
  }
}

std::string ToText(const Sizes& sizes) {
  std::string text;
  for (const int size : sizes) {
    text += (text.empty() ? "" : ",") + (size == kDynamic ? std::string("d") : std::to_string(size));
  }
  return text;
}

// Of the template specializations Ceres has, from 2.0 to 2.2, if it was built with any.
Sizes BestSpecialization(const Sizes& sizes) {
  if (!kCeresHasSchurSpecializations) {
    return {kDynamic, kDynamic, kDynamic};
  }
  constexpr std::array<Sizes, 14> kExact = {{{2, 2, 2},
                                             {2, 2, 3},
                                             {2, 2, 4},
                                             {2, 3, 3},
                                             {2, 3, 4},
                                             {2, 3, 6},
                                             {2, 3, 9},
                                             {2, 4, 3},
                                             {2, 4, 4},
                                             {2, 4, 6},
                                             {2, 4, 8},
                                             {2, 4, 9},
                                             {3, 3, 3},
                                             {4, 4, 2}}};
  constexpr std::array<Sizes, 2> kExactStereo = {{{4, 4, 3}, {4, 4, 4}}};
  const auto contains = [&sizes](const auto& list) { return std::find(list.begin(), list.end(), sizes) != list.end(); };
  if (contains(kExact) || contains(kExactStereo)) {
    return sizes;
  }
  if ((sizes[0] == 2 && sizes[1] >= 2 && sizes[1] <= 4) || (sizes[0] == 4 && sizes[1] == 4)) {
    return {sizes[0], sizes[1], kDynamic};
  }
  return sizes[0] == 2 ? Sizes{2, kDynamic, kDynamic} : Sizes{kDynamic, kDynamic, kDynamic};
}

}  // namespace

SchurStructure FindSchurStructure(const ProblemView& view, const LandmarkSelection& landmarks) {
  Sizes sizes = {0, 0, 0};
  for (const ResidualBlockView& residual : view.residuals) {
    const int* begin = view.SlotsOf(residual);
    const int* end = begin + residual.num_slots;
    const int* landmark = std::find_if(begin, end, [&](int b) { return landmarks.Contains(b); });
    if (residual.fixed || landmark == end) {
      continue;
    }
    Merge(residual.num_residuals, &sizes[0]);
    Merge(view.block(*landmark).tangent_size, &sizes[1]);
    for (const int* slot = begin; slot != end; ++slot) {
      if (slot != landmark && !view.block(*slot).constant) {
        Merge(view.block(*slot).tangent_size, &sizes[2]);
      }
    }
  }
  return {ToText(sizes), ToText(BestSpecialization(sizes))};
}

}  // namespace inceres::internal
