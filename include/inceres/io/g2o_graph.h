#pragma once

#include <memory>
#include <string>
#include <vector>

#include "inceres/export.h"
#include "inceres/factors/planar_relative_pose.h"
#include "inceres/factors/relative_pose.h"
#include "inceres/io/g2o.h"
#include "inceres/io/graph_options.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/status.h"

namespace inceres {

/// Which variables of a graph a pose graph has become.
struct G2oGraph {
  std::vector<VariableId> poses;  ///< by the dense index of the vertex (PoseGraph::ids)
  /// Of planar graphs: factor i is edge i, its slots `from` and `to`.
  FamilyHandle<PlanarRelativePoseFamily> planar;
  /// Of spatial graphs: factor i is edge i, its slots `to` and `from`.
  FamilyHandle<RelativePoseFamily> spatial;

  /// The factor that edge i has become.
  FactorId EdgeFactor(int edge) const {
    return {planar.id >= 0 ? planar.id : spatial.id, edge, -1};
  }
};

/// The vertices in the order of their ids, which is that of a trajectory.
INCERES_EXPORT std::vector<int> VerticesById(const PoseGraph& poses);

/// The edges, ascending, that are no odometry: those that do not join a vertex to the next one by
/// id. What robust methods suspect, the rest being known to be right.
INCERES_EXPORT std::vector<int> LoopEdges(const PoseGraph& poses);

/// An edge as a factor of slots from, to. False if its information is not positive definite.
[[nodiscard]] INCERES_EXPORT bool ToMeasurement(const PoseGraphEdge& edge,
                                                PlanarRelativePoseFamily::Measurement* measurement);
/// An edge as a factor of slots to, from: RelativePoseFamily measures where a is seen from b, and
/// has the rotation first. The information of the rotation is taken for that of the rotation
/// vector, and the position's for the axes of `from`, as Ceres's example of pose graphs does; g2o's
/// own error is the vector of the quaternion, half as long, in the axes that were measured. False
/// if the information is not positive definite.
[[nodiscard]] INCERES_EXPORT bool ToMeasurement(const PoseGraphEdge& edge,
                                                RelativePoseFamily::Measurement* measurement);

/// Adds the vertices of a pose graph as frames and its edges as factors. Planar poses [x, y, θ] are
/// Euclidean, spatial ones on PoseManifold. The vertices of FIX lines are held constant; where
/// there are none the gauge is free: HoldGauge (factors/gauge.h) holds the first pose.
///
/// kInvalidArgument, graph and ids unchanged, if the information of an edge is not positive
/// definite; the message names the edge. `ids` may be null. Cost: one pass. Threads: one writer.
INCERES_EXPORT Status AddPoseGraph(const PoseGraph& poses, const std::shared_ptr<const Loss>& loss,
                                   FactorGraph* graph, G2oGraph* ids);

/// Reads a g2o file into a graph: ReadG2o, then AddPoseGraph. On an error of either, graph and ids
/// are unchanged.
INCERES_EXPORT Status ReadG2o(const std::string& path, FactorGraph* graph, G2oGraph* ids = nullptr,
                              const GraphReadOptions& options = GraphReadOptions());

}  // namespace inceres
