#pragma once

#include <vector>

#include "linear/aggregation.h"
#include "linearize/incidences.h"

namespace inceres::internal {

/// Frames that accompany very many others in their factors, each of which has few of its own: the
/// intrinsics of a camera that took thousands of images, the mounting of a sensor. One flag a
/// frame.
std::vector<char> FindSharedFrames(const Evaluator& evaluator);

// What tells them, for processes that have some of the factors each, and add up. Counts are whole
// numbers.

/// Per frame the factors that touch it.
std::vector<double> CountFactorsOfFrames(const Evaluator& evaluator);
/// Those of them in which another frame is in far fewer. `factors`: per frame, of all processes.
std::vector<double> CountFactorsBesideFew(const Evaluator& evaluator,
                                          const std::vector<double>& factors);
/// Shared ones, by the two counts.
std::vector<char> FindSharedFrames(const std::vector<double>& factors,
                                   const std::vector<double>& beside_few);
/// Per frame those that share a factor with it, once a factor. Shared frames have none, and nobody
/// has them.
struct Companions {
  Companions(const Evaluator& evaluator, const std::vector<char>& is_shared);

  std::vector<int> begin;  // per frame, one more
  std::vector<int> frames;
};

/// Frames and how much two of them have in common: landmarks seen from both, and factors that touch
/// both. Of a landmark seen from very many, neighbors in its list count only. Shared frames have no
/// edges. Cost: Σ over landmarks of frames², bounded for each.
WeightedGraph CovisibilityGraph(const Evaluator& evaluator, const LandmarkIncidences& incidences,
                                const std::vector<char>& is_shared);

}  // namespace inceres::internal
