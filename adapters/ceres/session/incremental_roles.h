#pragma once

#include <vector>

#include "adapters/ceres/plan/landmark_selection.h"
#include "adapters/ceres/read/introspection.h"
#include "inceres/problem/factor_graph.h"

namespace inceres::internal {

/// What a block was in the last solve.
enum class PastRole : char { kNone, kFrame, kLandmark };

/// Roles of the parameter blocks in a solve that follows another. To change a role costs as much as to remove the block and add
/// it anew, so roles are sticky: landmarks stay landmarks as long as no two meet in a residual block, and frames become landmarks
/// when the selection makes them so. With `given` (by the user) the selection rules alone, but for constants, which keep their
/// roles.
///
/// Requires that no two blocks of the selection meet in a residual block. Cost: linear in slots.
std::vector<Role> ChooseIncrementalRoles(const ProblemView& view, const LandmarkSelection& selection, bool given,
                                         const std::vector<PastRole>& past);

}  // namespace inceres::internal
