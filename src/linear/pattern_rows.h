#pragma once

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

#include "inceres/linear/reduced_solver.h"

namespace inceres::internal {

/// A pattern whose block rows begin at these scalar rows, without any blocks yet: AppendRow gives
/// it one row after the other.
inline BlockPattern PatternWithoutBlocks(std::vector<int> offsets) {
  BlockPattern pattern;
  pattern.offsets = std::move(offsets);
  pattern.row_begin.push_back(0);
  pattern.value_begin.push_back(0);
  return pattern;
}

/// The next row has blocks in these columns, which ascend to the diagonal one. The values of a
/// block follow those of the one before, padded if those of the pattern are.
inline void AppendRow(const std::vector<int>& columns, BlockPattern* pattern) {
  const int row = static_cast<int>(pattern->row_begin.size()) - 1;
  for (const int column : columns) {
    pattern->columns.push_back(column);
    pattern->value_begin.push_back(pattern->value_begin.back() +
                                   static_cast<std::int64_t>(pattern->block_size(row)) *
                                       pattern->row_stride(column));
  }
  pattern->row_begin.push_back(static_cast<int>(pattern->columns.size()));
}

/// The pattern of blocks in these places (row, column), sorted, each once; every diagonal one is
/// among them.
inline BlockPattern PatternOf(std::vector<int> offsets,
                              const std::vector<std::pair<int, int>>& places) {
  BlockPattern pattern = PatternWithoutBlocks(std::move(offsets));
  std::vector<int> columns;
  for (const auto& [row, column] : places) {
    columns.push_back(column);
    if (row == column) {  // the last one of its row
      AppendRow(columns, &pattern);
      columns.clear();
    }
  }
  return pattern;
}

/// Columns of a block row below the diagonal, each once however often it is added.
class RowColumns {
 public:
  explicit RowColumns(int num_rows) : last_row_(static_cast<std::size_t>(num_rows), -1) {}

  /// The row has its diagonal block, and no other yet.
  void Begin(int row) {
    row_ = row;
    columns_.assign(1, row);
  }
  /// Left out where it is not below the diagonal.
  void Add(int column) {
    if (column < row_ && last_row_[static_cast<std::size_t>(column)] != row_) {
      last_row_[static_cast<std::size_t>(column)] = row_;
      columns_.push_back(column);
    }
  }
  /// Every column that there can be is there.
  bool IsFull() const { return static_cast<int>(columns_.size()) > row_; }
  /// As AppendRow takes them.
  const std::vector<int>& Ascending() {
    std::sort(columns_.begin(), columns_.end());
    return columns_;
  }

 private:
  int row_ = -1;
  std::vector<int> columns_;
  std::vector<int> last_row_;  // per column: the last one that it was added to
};

/// The block at (row, column), which is there: otherwise the result means nothing.
inline int FindBlock(const BlockPattern& pattern, int row, int column) {
  const auto first = pattern.columns.begin() + pattern.row_begin[row];
  const auto last = pattern.columns.begin() + pattern.row_begin[row + 1];
  return static_cast<int>(std::lower_bound(first, last, column) - pattern.columns.begin());
}

/// visit(i, j, k) for each block k of the pattern, that at (i, j), by rows.
template <typename Visit>
void ForEachBlock(const BlockPattern& pattern, const Visit& visit) {
  for (int i = 0; i < pattern.num_blocks(); ++i) {
    for (int k = pattern.row_begin[i]; k < pattern.row_begin[i + 1]; ++k) {
      visit(i, pattern.columns[k], k);
    }
  }
}

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

}  // namespace inceres::internal
