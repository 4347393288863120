#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "inceres/export.h"
#include "inceres/io/read_options.h"
#include "inceres/status.h"

namespace inceres {

/// A relative pose between two vertices of a pose graph: measurement ~ T_from^-1 T_to.
struct PoseGraphEdge {
  int from = 0;  ///< dense index of the vertex the measurement starts at
  int to = 0;    ///< dense index of the vertex it leads to
  /// 2D: [x y theta]; 3D: [x y z qx qy qz qw], the quaternion of unit length. Only the first
  /// PoseSize() entries are used.
  std::array<double, 7> measurement{};
  /// Inverse covariance in the tangent order of g2o, 2D: [x y theta], 3D: [x y z rx ry rz]; the
  /// full symmetric matrix, d x d row by row with d = TangentSize(). Only the first d * d entries
  /// are used.
  std::array<double, 36> information{};
};

/// A pose graph as read from a g2o file. All poses are of one kind: planar (dimension 2) or spatial
/// (dimension 3).
struct INCERES_EXPORT PoseGraph {
  int dimension = 0;              ///< 2 or 3
  std::vector<std::int64_t> ids;  ///< id in the file of each vertex; index = order of appearance
  /// num_vertices x PoseSize(): 2D [x y theta], 3D [x y z qx qy qz qw]; meters, radians
  std::vector<double> poses;
  std::vector<PoseGraphEdge> edges;  ///< in the order of the file
  /// dense indices named by FIX lines, in the order of the file, each once
  std::vector<int> fixed;

  /// Vertices of the file.
  int NumVertices() const { return static_cast<int>(ids.size()); }
  /// Doubles that store a pose: 3 or 7.
  int PoseSize() const { return dimension == 2 ? 3 : 7; }
  /// Degrees of freedom of a pose: 3 or 6.
  int TangentSize() const { return dimension == 2 ? 3 : 6; }
  /// The PoseSize() values of a vertex.
  double* PoseData(int vertex) {
    return poses.data() + static_cast<std::size_t>(vertex) * static_cast<std::size_t>(PoseSize());
  }
  /// The PoseSize() values of a vertex.
  const double* PoseData(int vertex) const {
    return poses.data() + static_cast<std::size_t>(vertex) * static_cast<std::size_t>(PoseSize());
  }

  /// The motion an edge measured, seen from one of its vertices: its measurement from `from`, the
  /// inverse from `to`. Only the first PoseSize() entries are used.
  std::array<double, 7> MotionFrom(const PoseGraphEdge& edge, int vertex) const;
  /// Where the edge puts its other end if `vertex`, one of its two, is at `pose`.
  std::array<double, 7> AcrossEdge(const PoseGraphEdge& edge, int vertex, const double* pose) const;
};

/// Reads a g2o pose graph (optionally .gz or .bz2): VERTEX_SE2, EDGE_SE2, VERTEX_SE3:QUAT,
/// EDGE_SE3:QUAT and FIX lines, blank lines and lines that start with '#'. Information matrices
/// come as their upper triangle, row by row. Lines may come in any order: edges and FIX lines may
/// name vertices that follow. Quaternions are normalized (files print a few digits only).
///
/// A file that has edges and no VERTEX line has the vertices its edges name, in the order of their
/// ids: the first at the origin, each later one where an edge puts it, from the vertex of the
/// highest id that has its place: along the odometry.
///
/// Every failure is kIo with a message `file:line: tag: field: what is wrong`: a missing file,
/// corrupt compression or one beyond the limit of `options`, an unknown tag, planar and spatial
/// poses in one file, a missing or surplus field, a number that is not finite, a quaternion of zero
/// length, a negative diagonal of an information matrix, a vertex twice, an edge or FIX that names
/// a vertex the file does not have, an edge from a vertex to itself, a file without vertices and
/// edges, and edges alone that do not hang together. `*graph` is then unchanged.
///
/// Cost: one pass over the file. Threads: no shared state.
INCERES_EXPORT Status ReadG2o(const std::string& path, PoseGraph* graph,
                              const ReadOptions& options = ReadOptions());

/// Writes a pose graph in the same format (compressed if the name ends in .gz or .bz2): vertices,
/// FIX lines, edges, in their order, numbers in the shortest form that reads back as the same
/// value. kInvalidArgument if the graph's sizes or indices do not fit together or a value is not
/// finite, the message names which; kIo with the path if it cannot be written. No half file is left
/// under the name.
INCERES_EXPORT Status WriteG2o(const std::string& path, const PoseGraph& graph);

/// Writes the poses as a trajectory in the format of the TUM RGB-D benchmark, by id: lines
/// `timestamp tx ty tz qx qy qz qw`, where the timestamp is the vertex's id; planar poses lie in z
/// = 0. What the tools evo and rpg_trajectory_evaluation read. Errors as WriteG2o. Source: Sturm et
/// al., "A benchmark for the evaluation of RGB-D SLAM systems", IROS 2012.
INCERES_EXPORT Status WriteTumTrajectory(const std::string& path, const PoseGraph& graph);

/// How near a pose graph's solution is to the global minimum of one particular cost: the chordal
/// one with isotropic noise.
struct ChordalBound {
  double cost = 0.0;                 ///< f at the minimum that was found
  double lower_bound = 0.0;          ///< what no choice of poses is below; at least 0
  double gap = 0.0;                  ///< (cost − lower_bound) / cost, 0 where the cost is
  double smallest_eigenvalue = 0.0;  ///< of the certificate matrix S; −ε says: a global minimum
  double largest_angle = 0.0;  ///< radians between a rotation as given and at the minimum found
};

/// Whether this build can compute it: it needs Spectra, an optional dependency.
INCERES_EXPORT bool HasChordalBound();

/// Minimizes, from the poses of the graph, and bounds from below
///
///     f(R, p) = Σ κ ‖R_j − R_i R_ij‖²_F + τ ‖p_j − p_i − R_i p_ij‖²
///
/// with κ and τ from the traces of each edge's covariance: κ = 3/(2 tr Σ_R), or half the inverse
/// variance of a planar angle; τ = d/tr Σ_p. The bound is that of Lagrangian duality: with the
/// multipliers Λ of RᵀR = I at the minimum found and Q the cost of rotations whose positions are
/// eliminated, S = Q − Λ, and f ≥ tr Λ − n d max(0, −λ_min(S)) whatever the poses, where tr Λ is
/// f_found as far as the gradient there is zero. λ_min is found by Lanczos on (S + σI)⁻¹, and the
/// bound is that of a shift for which S + σI was factored as positive definite: neither what the
/// solve nor what the eigenvalue's iteration has left makes it wrong. The rounding of sums and of
/// the factorization is not counted: some 1e-16 of κ for each entry.
///
/// It is a statement about f, and not a certificate of the cost that a solver of this library
/// minimizes, which has the geodesic error and the whole information matrix of each edge. Where
/// both minima are next to each other it tells that no other one is far below.
///
/// kUnavailable if this build has no Spectra; kInvalidArgument, naming it, if an edge's information
/// is not positive definite, or the graph does not fit together (AddPoseGraph) or does not hang
/// together; kSingular if the solve or the factorization fails. `bound` is then unchanged. Cost: a
/// solve, and some factorizations of n(d + 1) unknowns. Threads: no shared state. Source: Rosen,
/// Carlone, Bandeira & Leonard, "SE-Sync: a certifiably correct algorithm for synchronization over
/// the special Euclidean group", IJRR 2019.
INCERES_EXPORT Status BoundChordalCost(const PoseGraph& graph, ChordalBound* bound);

}  // namespace inceres
