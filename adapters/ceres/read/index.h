#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "src/base/counting_sort.h"

namespace inceres::internal {

/// An index kept as a signed number, for a std::vector.
inline std::size_t At(std::int64_t i) {
  return static_cast<std::size_t>(i);
}

/// Items by row.
struct CompressedRows {
  struct Row {
    const int* first;
    const int* last;
    const int* begin() const { return first; }
    const int* end() const { return last; }
    int size() const { return static_cast<int>(last - first); }
  };
  Row operator[](int row) const {
    return {items.data() + begin[At(row)], items.data() + begin[At(row) + 1]};
  }

  std::vector<int> begin;  ///< of each row, into items; one more than rows
  std::vector<int> items;
};

/// Calls for_each(add) twice, which calls add(row, item) for every item: a counting sort, items of
/// one row as they come.
template <typename ForEach>
CompressedRows SortIntoRows(std::size_t num_rows, const ForEach& for_each) {
  CompressedRows rows;
  CountingSort(num_rows, for_each, &rows.begin, &rows.items);
  return rows;
}

/// The same of items 0, 1, …, of which each goes to its row, or nowhere if that is −1.
inline CompressedRows SortIntoRows(std::size_t num_rows, const std::vector<int>& row_of) {
  return SortIntoRows(num_rows, [&row_of](const auto& add) {
    for (std::size_t i = 0; i < row_of.size(); ++i) {
      if (row_of[i] >= 0) {
        add(row_of[i], static_cast<int>(i));
      }
    }
  });
}

}  // namespace inceres::internal
