#pragma once

#include <vector>

#include "base/counting_sort.h"
#include "inceres/linear/reduced_matrix.h"

namespace inceres::internal {

/// visit(i, j), j < i, for each block of the strict lower triangle, by rows.
template <typename Visit>
void ForEachCoupling(const BlockPattern& pattern, const Visit& visit) {
  for (int i = 0; i < pattern.num_blocks(); ++i) {
    // The diagonal block is the last of its row and ends the loop.
    for (int k = pattern.row_begin[i]; pattern.columns[k] < i; ++k) {
      visit(i, pattern.columns[k]);
    }
  }
}

/// The graph of S: of each block row those it is coupled to, without itself, ascending, in one
/// array. Each has the other.
template <typename Index>
struct BlockNeighbors {
  BlockNeighbors() = default;
  explicit BlockNeighbors(const BlockPattern& pattern) {
    const auto for_each_neighbor = [&pattern](const auto& add) {
      ForEachCoupling(pattern, [&add](int i, int j) {
        add(i, j);
        add(j, i);
      });
    };
    CountingSort(pattern.num_blocks(), for_each_neighbor, &begin, &rows);
  }

  std::vector<Index> begin;  // per row, and one more
  std::vector<Index> rows;
};

}  // namespace inceres::internal
