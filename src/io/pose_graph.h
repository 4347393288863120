#pragma once

#include <array>
#include <string>

#include "inceres/io/g2o.h"
#include "inceres/status.h"

namespace inceres::internal {

/// Whether all of a pose graph fits together: sizes, ends of edges, finite numbers. A caller may
/// have made it by hand. kInvalidArgument names the member and the index in it. Cost: one pass.
Status CheckPoseGraph(const PoseGraph& graph);

/// Start values for a graph without any: vertex 0 at the origin, every other where an edge puts it
/// from one that has its place. Lower indices come first, each from the highest one that is placed
/// already: along the odometry where there is one. Returns the lowest index that no chain of edges
/// leads to, NumVertices() if there is none; `poses` is sized by this function.
///
/// Cost: O(E log E).
int PlaceAlongEdges(PoseGraph* graph);

/// Says so of such a vertex, by the ids.
std::string NoWay(const PoseGraph& graph, int lost);

/// A planar pose in the plane z = 0: a turn about z by θ has the quaternion (0, 0, sin θ/2,
/// cos θ/2).
std::array<double, 7> InSpace(const double* planar_pose);

}  // namespace inceres::internal
