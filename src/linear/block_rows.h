#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/aligned_vector.h"
#include "inceres/linear/reduced_solver.h"
#include "simd/kernels.h"

namespace inceres::internal {

/// A symmetric block-sparse matrix that grows: block rows are appended, blocks are added where two
/// rows become coupled, and the room of removed rows is used again. Only the lower triangle is
/// stored, a row's blocks sorted by column, its diagonal block last. Of the upper one it is known
/// where blocks are.
///
/// Block (i, j) is d_i × d_j, row-major with rows padded to quads (the padding zero), so that a
/// kernel can add into it directly.
class SymmetricBlockRows {
 public:
  struct Entry {
    int column;
    std::int64_t offset;  // of the block's values, in doubles
  };

  int num_rows() const { return static_cast<int>(sizes_.size()); }
  int size_of(int row) const { return sizes_[row]; }
  /// Blocks (row, column ≤ row), by column; empty for a row that was removed.
  const std::vector<Entry>& row(int row) const { return rows_[row]; }
  /// The rows > column with a block in this column, ascending.
  const std::vector<int>& below(int column) const { return below_[column]; }

  /// Calls visit(other) of the rows that it has a block with, ascending, itself among them.
  template <typename Visit>
  void ForEachCoupled(int row, const Visit& visit) const {
    for (const Entry& entry : rows_[row]) {
      visit(entry.column);
    }
    for (const int below : below_[row]) {
      visit(below);
    }
  }
  /// Blocks off the diagonal in the row and in its column; of a row that is there.
  std::size_t Degree(int row) const { return rows_[row].size() - 1 + below_[row].size(); }

  /// Appends a row with a zero diagonal block; returns its index.
  int AddRow(int size);

  /// Removes a row and all its blocks; the index stays, with size 0, until ReviveRow.
  void RemoveRow(int row);
  /// Gives a removed row a size and a zero diagonal block again.
  void ReviveRow(int row, int size);

  /// When the row is eliminated (BlockPattern::groups); 0 unless told otherwise. Another group is
  /// another structure.
  void SetGroup(int row, int group);
  int group_of(int row) const { return row < static_cast<int>(groups_.size()) ? groups_[row] : 0; }
  bool has_groups() const { return num_grouped_ > 0; }

  /// Zeroes all blocks (row, ·) and (·, row); or all of all rows. Like RemoveRow it costs what the
  /// row's blocks do.
  void ZeroRow(int row);
  void Zero();

  /// The block's values, adding a zero block if there is none; row ≥ column.
  std::int64_t FindOrAdd(int row, int column);

  /// Removes a block off the diagonal, which is there; row > column.
  void RemoveBlock(int row, int column);

  /// Offset of the block, or -1.
  std::int64_t Find(int row, int column) const;

  /// The rows that are there, and their blocks, as a pattern over values(0). Cost: that of a pass
  /// over the blocks, the first time after one or a row came or went; else none. Threads: one
  /// caller.
  const BlockPattern& Pattern() const;
  /// Per row of Pattern(), as it was last asked for: the row.
  const std::vector<int>& pattern_rows() const { return pattern_rows_; }
  /// Another number when a block or a row has come or gone.
  std::int64_t version() const { return version_; }
  /// Another number when a row that was there has gone or come back.
  std::int64_t resized_version() const { return resized_version_; }
  /// Another number when a block has gone, alone or with its row.
  std::int64_t num_released() const { return num_released_; }

  std::int64_t Bytes() const;

  double* values(std::int64_t offset) { return values_.data() + offset; }
  const double* values(std::int64_t offset) const { return values_.data() + offset; }

 private:
  std::int64_t Allocate(int rows, int columns);
  void Release(std::int64_t offset, int rows, int columns);

  std::vector<int> sizes_;
  std::vector<int> groups_;  // of the rows up to the last that was ever in another group than 0
  int num_grouped_ = 0;      // rows in another group than 0
  std::vector<std::vector<Entry>> rows_;
  std::vector<std::vector<int>> below_;
  AlignedVector<double> values_;
  std::vector<std::vector<std::int64_t>> free_;  // released blocks, by their length in quads
  std::int64_t version_ = 0;
  std::int64_t resized_version_ = 0;
  std::int64_t num_released_ = 0;
  std::size_t list_bytes_ = 0;  // of the lists in rows_ and below_
  mutable std::int64_t pattern_version_ = -1;
  mutable BlockPattern pattern_;
  mutable std::vector<int> pattern_rows_;
};

}  // namespace inceres::internal
