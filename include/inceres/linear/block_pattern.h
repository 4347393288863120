#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace inceres {

/// Where the blocks of the symmetric reduced matrix S are: the lower triangle, block rows in order, columns ascending within a
/// row, the diagonal block always present and last in its row. Block (i, j) is d_i × d_j, row-major, without padding, at
/// values[value_begin[k]]; of a diagonal block the whole square is stored.
struct BlockPattern {
  std::vector<int> offsets;               ///< first scalar row of each block row; one more entry than blocks: the total size
  std::vector<int> row_begin;             ///< blocks of row i are [row_begin[i], row_begin[i + 1])
  std::vector<int> columns;               ///< block column of each block
  std::vector<std::int64_t> value_begin;  ///< offset of each block's values; one more entry: the total count

  int num_blocks() const { return static_cast<int>(offsets.size()) - 1; }
  int size() const { return offsets.back(); }
  int block_size(int i) const { return offsets[static_cast<std::size_t>(i) + 1] - offsets[static_cast<std::size_t>(i)]; }
};

}  // namespace inceres
