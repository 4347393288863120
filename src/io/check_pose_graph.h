#pragma once

#include "inceres/io/g2o.h"
#include "inceres/status.h"

namespace inceres::internal {

/// Whether all of a pose graph fits together: sizes, ends of edges, finite numbers. A caller may
/// have made it by hand. kInvalidArgument names the member and the index in it. Cost: one pass.
Status CheckPoseGraph(const PoseGraph& graph);

}  // namespace inceres::internal
