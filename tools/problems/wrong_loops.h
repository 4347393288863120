#pragma once

#include <cstdint>
#include <vector>

#include "inceres/io/g2o.h"
#include "inceres/status.h"

namespace inceres::tools {

/// Which wrong loops are added.
struct WrongLoopOptions {
  /// In [0, 1): wrong ones among all loops, once they are added: n_wrong = f / (1 − f) n_right.
  double fraction = 0.0;
  std::uint64_t seed = 1;
  /// A wrong loop's squared error at the reference is more than this, or it is drawn again: what is
  /// within the noise of a right one is not wrong.
  double least_squared_error = 0.0;
};

/// Appends wrong loops to a graph: two vertices at random that no edge of the graph joins and that
/// are not neighbors, with measurement and information of a right loop at random, as a place that
/// is taken for another has. `reference` has the same vertices where they belong. The same seed
/// gives the same loops on every platform. kInvalidArgument, the graph unchanged, if the fraction
/// is not in [0, 1), the graph has no loops, or no wrong loops are found in it.
Status AddWrongLoops(const WrongLoopOptions& options, const PoseGraph& reference, PoseGraph* graph);

/// ‖U e‖² of an edge at the poses of a graph: e as RelativePoseFamily and PlanarRelativePoseFamily
/// have it.
double SquaredError(const PoseGraph& graph, const PoseGraphEdge& edge);

}  // namespace inceres::tools
