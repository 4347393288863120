#pragma once

#include <vector>

#include "base/counting_sort.h"
#include "inceres/linear/reduced_solver.h"
#include "linear/pattern_rows.h"

namespace inceres::internal {

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

/// The rows of the whole matrix of which a pattern has the lower triangle, without the blocks k
/// that !keeps(k): of each row its blocks by ascending column, those of the upper triangle as the
/// ones that they mirror.
struct WholeRows {
  struct Place {
    int block;
    int column;
  };
  template <typename Keeps>
  WholeRows(const BlockPattern& pattern, const Keeps& keeps) {
    const auto for_each_place = [&](const auto& add) {
      ForEachBlock(pattern, [&](int i, int j, int k) {
        if (keeps(k)) {
          add(i, Place{k, j});
          if (j != i) {
            add(j, Place{k, i});
          }
        }
      });
    };
    CountingSort(pattern.num_blocks(), for_each_place, &begin, &places);
  }

  std::vector<int> begin;  // per row, and one more
  std::vector<Place> places;
};

}  // namespace inceres::internal
