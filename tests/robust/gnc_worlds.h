#pragma once

#include <algorithm>
#include <vector>

#include "inceres/io/g2o_graph.h"
#include "inceres/io/pose_graph_start.h"
#include "inceres/solver/gnc.h"
#include "support/pose_graph_world.h"

namespace inceres::test {

/// A world with wrong loops as a factor graph at its chordal start, and what is suspected in it.
struct GncWorld {
  explicit GncWorld(const PoseGraphWorld& the_world) : world(the_world) {
    start = world.WithoutPlaces();
    started = StartAlongSpanningTree(&start);
    added = AddPoseGraph(start, nullptr, &graph, &ids);
    graph.SetConstant(ids.poses[0], true);
    loops = LoopEdges(start);
    for (const int edge : loops) {
      suspects.push_back(ids.EdgeFactor(edge));
    }
  }

  bool IsWrong(std::size_t suspect) const {
    return suspect >= suspects.size() - static_cast<std::size_t>(world.num_wrong);
  }

  GncOptions Options() {
    GncOptions options;
    options.solver.strategy = TrustRegionStrategyKind::kDogleg;
    options.start = ChordalGncStart(start, ids, loops);
    return options;
  }

  PoseGraph Solved() const {
    PoseGraph solved = world.truth;
    for (int i = 0; i < solved.NumVertices(); ++i) {
      std::copy_n(graph.Values(ids.poses[static_cast<std::size_t>(i)]), solved.PoseSize(),
                  solved.PoseData(i));
    }
    return solved;
  }

  PoseGraphWorld world;
  PoseGraph start;
  Status started;
  Status added;
  FactorGraph graph;
  G2oGraph ids;
  std::vector<int> loops;
  std::vector<FactorId> suspects;
};

}  // namespace inceres::test
