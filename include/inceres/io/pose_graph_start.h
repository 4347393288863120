#pragma once

#include <memory>
#include <vector>

#include "inceres/export.h"
#include "inceres/io/g2o.h"
#include "inceres/io/g2o_graph.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/solver/gnc.h"
#include "inceres/status.h"

namespace inceres {

/// Places every vertex along edges from the first one of the graph, which stays where it is: each
/// from the one of the highest index that has its place, along the odometry where there is one.
/// What ReadG2o does with a file that has no vertices.
///
/// kInvalidArgument, the graph unchanged, if it does not fit together (AddPoseGraph), or no edges
/// lead to a vertex; the message names the culprit. Cost: O(E log E). Threads: no shared state.
INCERES_EXPORT Status StartAlongSpanningTree(PoseGraph* graph);

/// Start values from all edges at once, without any start: rotations by the chordal relaxation,
/// then positions by linear least squares.
///
///     planar:  min Σ κ |z_j − z_i z_ij|²                    z = e^{iθ} without |z| = 1
///     spatial: min Σ κ ‖R_j − R_i R_ij‖²_F                  R without RᵀR = I, each then projected
///     both:    min Σ ‖U_t R_iᵀ (p_j − p_i − R_i p_ij)‖²    U_tᵀU_t the information of the position
///
/// κ is d/(2 tr Σ_R) of the rotation's own information (d = 3), or the inverse variance of the
/// angle. Linear and exact without noise; with noise in every loop it mostly ends in the basin of
/// the global minimum, where odometry does not. The first vertex stays where it is.
///
/// An object keeps the structure of its graph from call to call, as GNC needs it
/// (GncOptions::start). Cost: a sparse Cholesky of d doubles a vertex for positions, one for planar
/// rotations, three for spatial ones. Threads: one call at a time. Source: Martinec & Pajdla,
/// "Robust rotation and translation estimation in multiview reconstruction", CVPR 2007; Carlone,
/// Tron, Daniilidis & Dellaert, "Initialization techniques for 3D SLAM", ICRA 2015.
class INCERES_EXPORT ChordalStart {
 public:
  /// For a graph whose edges do not change; it is copied. `num_threads` are those of the linear
  /// solver. What is wrong with the graph is told by Compute.
  explicit ChordalStart(const PoseGraph& graph, int num_threads = 1);
  ~ChordalStart();
  ChordalStart(const ChordalStart&) = delete;
  ChordalStart& operator=(const ChordalStart&) = delete;

  /// Poses for the edges with these weights, one each, at least 0, or all 1 if there are none: laid
  /// out as PoseGraph::poses. Only edges of positive weight count.
  ///
  /// kInvalidArgument, `poses` unchanged, if the graph does not fit together (AddPoseGraph), the
  /// number of weights is another, one is negative or not finite, or no edges that count lead from
  /// the first vertex to one that the message names; kSingular if the linear systems cannot be
  /// solved.
  Status Compute(const std::vector<double>& weights, std::vector<double>* poses);

 private:
  class INCERES_HIDDEN Impl;
  std::unique_ptr<Impl> impl_;
};

/// The same once, with all weights 1, into the graph's poses. Errors as of Compute, the graph
/// unchanged.
INCERES_EXPORT Status StartByChordalRelaxation(PoseGraph* graph, int num_threads = 1);

/// What GncOptions::start of a pose graph is: the chordal start of all edges, those of
/// `suspected_edges` with the weights that are given, in that order, into the poses of the graph
/// that `ids` names. Copies what it needs.
///
/// What is wrong is told by each call of what it returns, the graph unchanged: kInvalidArgument if
/// the pose graph does not fit together (AddPoseGraph), a suspected edge is none of its edges,
/// `ids` has not a pose for each of its vertices, the number of weights is not that of suspected
/// edges, or the graph does not have these variables; else as of Compute.
INCERES_EXPORT GncStart ChordalGncStart(const PoseGraph& poses, const G2oGraph& ids,
                                        std::vector<int> suspected_edges, int num_threads = 1);

}  // namespace inceres
