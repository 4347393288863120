#pragma once

#include <vector>

#include "linear/coarse_space.h"
#include "linear/frame_clusters.h"
#include "linearize/incidences.h"
#include "linearize/product_plan.h"

namespace inceres::internal {

/// Frames in aggregates for a two-level preconditioner: those that see the same, of about eight
/// frames each, or of sixteen, 32, …: the smallest whose coarse system is cheap beside the products
/// with S that conjugate gradients take. A shared frame (FindSharedFrames) is an aggregate by
/// itself.
struct FrameAggregates {
  /// `forms_S`: what a product with S reads is S, not Y.
  FrameAggregates(const Evaluator& evaluator, const LandmarkIncidences& incidences, bool forms_S);

  FrameClusters clusters;
  std::vector<char> is_shared;  // per frame
  int count = 0;
};

/// What columns of a few numbers for each aggregate reach when S is multiplied with them.
struct AggregateReach {
  AggregateReach(const FrameAggregates& aggregates, std::vector<int> widths,
                 const LandmarkIncidences& incidences, const BlockPattern& pattern);

  CoarseShape shape;
  // per aggregate, and one more: the landmarks that its frames see, ascending
  std::vector<int> landmarks_begin;
  std::vector<int> landmarks;
};

}  // namespace inceres::internal
