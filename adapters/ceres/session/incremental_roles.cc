#include "adapters/ceres/session/incremental_roles.h"

#include <algorithm>

#include "adapters/ceres/read/index.h"

namespace inceres::internal {
namespace {

// Where two landmarks meet, those that the selection does not want give way; at most one is left then. A constant counts too: it
// may be variable in the next solve.
void Separate(const ProblemView& view, const LandmarkSelection& selection, std::vector<Role>* roles) {
  const auto is_landmark = [&](int b) { return (*roles)[At(b)] == Role::kLandmark; };
  for (const ResidualBlockView& residual : view.residuals) {
    const int* begin = view.SlotsOf(residual);
    const int* end = begin + residual.num_slots;
    if (std::count_if(begin, end, is_landmark) < 2) {
      continue;
    }
    bool taken = std::any_of(begin, end, [&](int b) { return selection.Contains(b); });
    for (const int* b = begin; b != end; ++b) {
      if (is_landmark(*b) && !selection.Contains(*b)) {
        (*roles)[At(*b)] = taken ? Role::kFrame : Role::kLandmark;
        taken = true;
      }
    }
  }
}

}  // namespace

std::vector<Role> ChooseIncrementalRoles(const ProblemView& view, const LandmarkSelection& selection, bool given,
                                         const std::vector<PastRole>& past) {
  std::vector<Role> roles(view.blocks.size(), Role::kFrame);
  for (std::size_t b = 0; b < view.blocks.size(); ++b) {
    const bool was_landmark = past[b] == PastRole::kLandmark;
    const bool selected = selection.is_landmark[b] != 0;
    if (view.blocks[b].constant ? was_landmark : (selected || (was_landmark && !given))) {
      roles[b] = Role::kLandmark;
    }
  }
  Separate(view, selection, &roles);
  return roles;
}

}  // namespace inceres::internal
