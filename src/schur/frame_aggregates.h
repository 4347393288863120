#pragma once

#include <vector>

#include "linear/aggregation.h"
#include "linear/coarse_columns.h"
#include "linearize/incidences.h"
#include "linearize/product_plan.h"

namespace inceres::internal {

/// Frames in aggregates for a two-level preconditioner: those that see the same, of about eight
/// frames each, or of sixteen, 32, …: the smallest whose coarse system is cheap beside the products
/// with S that conjugate gradients take. A shared frame (FindSharedFrames) is an aggregate by
/// itself.
struct FrameAggregates {
  FrameAggregates() = default;
  /// `forms_S`: what a product with S reads is S, not Y.
  FrameAggregates(const Evaluator& evaluator, const LandmarkIncidences& incidences, bool forms_S);

  /// By the covisibility of the frames; `numbers_read`: by a product with S.
  void Join(const WeightedGraph& covisibility, double numbers_read, const Executor& executor);

  FrameClusters clusters;
  std::vector<char> is_shared;  // per frame
  int count = 0;
};

/// What a product with an S that is not formed reads of Y, or as much of the Jacobians.
double NumbersReadWithoutS(const LandmarkIncidences& incidences);

/// What columns of a few numbers for each aggregate reach when S is multiplied with them.
struct AggregateReach {
  AggregateReach() = default;
  AggregateReach(const FrameAggregates& aggregates, std::vector<int> widths,
                 const LandmarkIncidences& incidences, const BlockPattern& pattern);

  CoarseShape shape;
  // per aggregate, and one more: the landmarks that its frames see, ascending
  std::vector<int> landmarks_begin;
  std::vector<int> landmarks;
};

}  // namespace inceres::internal
