#pragma once

#include <cstdint>
#include <vector>

#include "tools/sim/portable_math.h"

namespace inceres::internal {

/// How often a point is seen: 2 + a geometric distribution with this mean in all, many short tracks
/// and a few long ones, as in real data.
int DrawTrackLength(double mean, Random* random);

/// Rounds over the tracks that lengthen or shorten them by one until there are `total`
/// observations; a track has at least two and at most `longest`. Returns how many are missing: 0,
/// or as many as the longest tracks fall short (shortest: exceed, negative).
std::int64_t AdjustTrackLengths(std::int64_t total, const std::vector<int>& longest,
                                std::vector<int>* lengths);

}  // namespace inceres::internal
