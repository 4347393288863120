#pragma once

#include <set>
#include <vector>

namespace inceres::internal {

/// Pairs (a, b) of which a factor in this order has a before b, though a's group is above b's and
/// both are coupled: in the matrix, or by what is eliminated before both. `neighbors`: per row,
/// those it has a block with.
inline int CountMisplaced(const std::vector<int>& order, std::vector<std::set<int>> neighbors,
                          const std::vector<int>& groups) {
  std::vector<char> done(neighbors.size(), 0);
  int misplaced = 0;
  for (const int row : order) {
    const auto r = static_cast<std::size_t>(row);
    done[r] = 1;
    std::vector<int> later;
    for (const int other : neighbors[r]) {
      if (done[static_cast<std::size_t>(other)] == 0) {
        later.push_back(other);
        misplaced += groups[r] > groups[static_cast<std::size_t>(other)] ? 1 : 0;
      }
    }
    // Its elimination couples what is left of its neighbors.
    for (const int a : later) {
      for (const int b : later) {
        if (a != b) {
          neighbors[static_cast<std::size_t>(a)].insert(b);
        }
      }
    }
  }
  return misplaced;
}

}  // namespace inceres::internal
