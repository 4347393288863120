#pragma once

#include <memory>
#include <string>
#include <vector>

#include "inceres/export.h"
#include "inceres/factors/planar_relative_pose.h"
#include "inceres/factors/relative_pose.h"
#include "inceres/io/g2o.h"
#include "inceres/io/read_options.h"
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
  /// Of spatial graphs in another convention than kGeodesic: factor i is edge i, its slots `from`
  /// and `to`.
  FamilyHandle<PoseEdgeFamily> edges;

  /// The factor that edge i has become.
  FactorId EdgeFactor(int edge) const {
    const FamilyId family = planar.id >= 0 ? planar.id : spatial.id >= 0 ? spatial.id : edges.id;
    return {family, edge, -1};
  }
};

/// What becomes of an edge whose information matrix is not positive definite.
enum class IndefiniteInformation {
  kRefuse,   ///< the edge is named, and nothing is added
  kProject,  ///< ProjectInformation, and it counts like any other
};

/// How a pose graph becomes a factor graph.
struct PoseGraphOptions {
  std::shared_ptr<const Loss> loss;  ///< of every edge; null: ½‖f‖²
  /// What the edges' information is about. Planar edges: kG2o and kGtsam have the position's error
  /// in the axes of the measured pose, the others in those of `from`.
  PoseErrorConvention convention = PoseErrorConvention::kGeodesic;
  /// of matrices that are not positive definite
  IndefiniteInformation indefinite = IndefiniteInformation::kRefuse;
};

/// Replaces a symmetric matrix (row-major, size × size, at most 6) by the nearest one, in the
/// Frobenius norm, whose eigenvalues are at least 1e-9 times the largest. Returns whether that
/// changed it; false, the matrix unchanged, too where an entry is not finite or no eigenvalue is
/// positive. Source: Higham, "Computing a nearest symmetric positive semidefinite matrix", 1988.
INCERES_EXPORT bool ProjectInformation(double* information, int size);

/// The vertices in the order of their ids, which is that of a trajectory.
INCERES_EXPORT std::vector<int> VerticesById(const PoseGraph& poses);

/// The edges, ascending, that are no odometry: those that do not join a vertex to the next one by
/// id. What robust methods suspect, the rest being known to be right. An edge with an end that is
/// no vertex is among them; AddPoseGraph refuses the graph for it.
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

/// An edge as a factor of slots from, to, in an error convention: the information of the file is
/// that of the convention's own error. False if it is not positive definite.
[[nodiscard]] INCERES_EXPORT bool ToMeasurement(const PoseGraphEdge& edge,
                                                PoseEdgeFamily::Measurement* measurement);
/// The same of a planar edge: the information is turned into the axes of `from` where the
/// convention has the position's error in those of the measured pose, which is exact.
[[nodiscard]] INCERES_EXPORT bool ToMeasurement(const PoseGraphEdge& edge,
                                                PoseErrorConvention convention,
                                                PlanarRelativePoseFamily::Measurement* measurement);

/// Adds the vertices of a pose graph as frames and its edges as factors. Planar poses [x, y, θ] are
/// Euclidean, spatial ones on PoseManifold. The vertices of FIX lines are held constant; where
/// there are none the gauge is free: HoldGauge (factors/gauge.h) holds the first pose.
///
/// kInvalidArgument, graph and ids unchanged, if the information of an edge is not positive
/// definite, or the pose graph does not fit together; the message names the culprit. `ids` may be
/// null. Cost: one pass. Threads: one writer.
INCERES_EXPORT Status AddPoseGraph(const PoseGraph& poses, const std::shared_ptr<const Loss>& loss,
                                   FactorGraph* graph, G2oGraph* ids);

/// The same in another error convention, or with information matrices projected.
INCERES_EXPORT Status AddPoseGraph(const PoseGraph& poses, const PoseGraphOptions& options,
                                   FactorGraph* graph, G2oGraph* ids);

/// Reads a g2o file into a graph: ReadG2o, then AddPoseGraph. On an error of either, graph and ids
/// are unchanged.
INCERES_EXPORT Status ReadG2o(const std::string& path, FactorGraph* graph, G2oGraph* ids = nullptr,
                              const GraphReadOptions& options = GraphReadOptions());

}  // namespace inceres
