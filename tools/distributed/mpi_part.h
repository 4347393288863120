#pragma once

#include <memory>
#include <vector>

#include "inceres/distributed/distributed_solver.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/problem/losses.h"
#include "tools/distributed/tracks.h"

namespace inceres::tools {

/// The points here and the cameras they see, as the part of a rank. Ids are the numbers in the
/// file.
struct MpiPart {
  MpiPart(const Tracks& tracks, const std::shared_ptr<const Loss>& loss);

  /// Values of points, and of all cameras, from the ranks that have them, into the tracks.
  /// Collective.
  void TakeSolution(MPI_Comm comm, Tracks* tracks) const;

  FactorGraph graph;
  GraphPart part;
};

}  // namespace inceres::tools
