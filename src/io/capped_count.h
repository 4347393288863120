#pragma once

#include <algorithm>
#include <climits>
#include <cstddef>

namespace inceres::internal {

/// How many values to make room for, as FactorGraph::Reserve takes it. What is more than an int
/// counts, the values of 700 million points, finds its room as it comes.
inline int CappedCount(std::size_t count) {
  return static_cast<int>(std::min(count, static_cast<std::size_t>(INT_MAX)));
}

}  // namespace inceres::internal
