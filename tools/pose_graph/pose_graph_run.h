#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "inceres/io/g2o.h"
#include "inceres/io/g2o_graph.h"
#include "inceres/solver/gnc.h"
#include "inceres/solver/summary.h"

namespace inceres::tools {

/// Where the poses begin.
enum class PoseGraphStart { kFile, kSpanningTree, kChordal };

/// What pose_graph_solve is to do with a graph.
struct PoseGraphPlan {
  SolverOptions solver;
  PoseGraphOptions graph;
  PoseGraphStart start = PoseGraphStart::kFile;
  bool gnc = false;
  bool chordal_rounds = true;  ///< each weighted problem begins at its chordal start
  bool suspect_all = false;    ///< odometry too
  GncOptions gnc_options;
  double outliers = 0.0;  ///< wrong loops to add, of all loops
  std::uint64_t seed = 1;
  bool certificate = false;
};

/// How the verdicts on wrong loops that were added compare with the truth.
struct OutlierScore {
  int num_wrong = 0;
  int num_wrong_found = 0;
  int num_right = 0;
  int num_right_lost = 0;
  double rms_difference = 0.0;  ///< of positions, to the solution without wrong loops
  double extent = 0.0;          ///< diagonal of the box around that solution
};

struct PoseGraphRun {
  PoseGraph before;               ///< at the start, wrong loops included
  PoseGraph after;                ///< the same edges
  std::vector<int> loops;         ///< edges that are no odometry
  std::vector<bool> is_outlier;   ///< by edge: the verdict
  int first_wrong_edge = 0;       ///< those from here on were added
  Summary solve;                  ///< without GNC
  std::optional<GncSummary> gnc;  ///< with it
  std::optional<OutlierScore> score;
  std::optional<ChordalBound> bound;
  std::string bound_failure;  ///< why there is none, if one was asked for
  double initial_cost = 0.0;
  double final_cost = 0.0;
  double seconds = 0.0;  ///< of the solve, start included
};

/// Carries the plan out. An error says which part of it could not be done.
Status RunPoseGraph(const PoseGraphPlan& plan, const PoseGraph& graph, PoseGraphRun* run);

/// The solved graph without the edges that were found to be wrong.
PoseGraph WithoutOutliers(const PoseGraphRun& run);

/// The graph with wrong loops as `plan` says, none if plan.outliers is 0, and the solution without
/// them, at which they are wrong: squared errors are above four times the threshold of GNC.
Status WithWrongLoops(const PoseGraphPlan& plan, PoseGraph* graph, PoseGraph* reference);

}  // namespace inceres::tools
