#pragma once

#include "inceres/io/g2o.h"

namespace inceres::internal {

/// Start values for a graph without any: vertex 0 at the origin, every other where an edge puts it
/// from one that has its place. Lower indices come first, each from the highest one that is placed
/// already: along the odometry where there is one. Returns the lowest index that no chain of edges
/// leads to, NumVertices() if there is none; `poses` is sized by this function.
///
/// Cost: O(E log E).
int PlaceAlongEdges(PoseGraph* graph);

}  // namespace inceres::internal
