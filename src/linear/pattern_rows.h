#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "inceres/linear/reduced_matrix.h"

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

}  // namespace inceres::internal
