#include "linear/block_rows.h"

#include <algorithm>
#include <initializer_list>

#include "base/growth_count.h"
#include "simd/kernels.h"

namespace inceres::internal {

// S of the incremental mode, as a matrix that is edited (docs/algorithms.md, "Incremental Schur
// complement"). Values lie in one array; a block keeps its offset as long as it lives, so others
// may remember where a block is. Rows keep their index for good: a removed row has size 0 and no
// blocks until it is revived, and the array's room is used again block by block.
//
// rows_[i] has the blocks (i, j ≤ i), and below_[j] the rows of the blocks under the diagonal of
// column j: the structure of both triangles, so that a row can be removed, zeroed or ordered at the
// cost of its own blocks. Both lists are sorted, which gives every pass over S one order.
//
// version_ counts edits of the structure, not of values. Whoever keeps something that depends on
// the structure compares versions instead of being told.

namespace {

bool BeforeColumn(const SymmetricBlockRows::Entry& entry, int column) {
  return entry.column < column;
}

// What a block takes, with its rows padded to quads. Blocks of equal length can trade places.
std::size_t QuadsOf(int rows, int columns) {
  return static_cast<std::size_t>(rows) * PadToQuad(columns) / kQuad;
}

}  // namespace

int SymmetricBlockRows::AddRow(int size) {
  ++version_;
  const int row = num_rows();
  sizes_.push_back(size);
  // The diagonal block is there from the start and stays last in its row: others rely on back().
  rows_.push_back({{row, Allocate(size, size)}});
  below_.emplace_back();
  list_bytes_ += rows_.back().capacity() * sizeof(Entry);
  return row;
}

// The row's index stays, as others refer to it; only its blocks, in both triangles, go.
void SymmetricBlockRows::RemoveRow(int row) {
  ++version_;
  ++resized_version_;
  // The blocks left of the diagonal, and the row's mention in their columns.
  for (const Entry& entry : rows_[row]) {
    Release(entry.offset, sizes_[row], sizes_[entry.column]);
    if (entry.column != row) {
      std::vector<int>& below = below_[entry.column];
      below.erase(std::lower_bound(below.begin(), below.end(), row));
    }
  }
  rows_[row].clear();
  // The blocks of its column, which belong to later rows.
  for (const int below : below_[row]) {
    auto& entries = rows_[below];
    const auto entry = std::lower_bound(entries.begin(), entries.end(), row, BeforeColumn);
    Release(entry->offset, sizes_[below], sizes_[row]);
    entries.erase(entry);
  }
  below_[row].clear();
  sizes_[row] = 0;
  SetGroup(row, 0);
}

// The list of groups is only as long as it has to be: of a problem without groups it is empty. A
// row that goes back to group 0 leaves its place there.
void SymmetricBlockRows::SetGroup(int row, int group) {
  if (group == group_of(row)) {
    return;
  }
  ++version_;
  num_grouped_ += (group != 0 ? 1 : 0) - (group_of(row) != 0 ? 1 : 0);
  groups_.resize(std::max(groups_.size(), static_cast<std::size_t>(row) + 1), 0);
  groups_[row] = group;
}

void SymmetricBlockRows::ReviveRow(int row, int size) {
  ++version_;
  ++resized_version_;
  sizes_[row] = size;
  // The size may be another than before it was removed. Nothing is coupled to it yet.
  const GrowthCount growth(rows_[row], &list_bytes_);
  rows_[row].assign(1, {row, Allocate(size, size)});
}

// A pass over the row's own blocks and a search for each of those below it. The structure stays,
// and with it all offsets and version_.
void SymmetricBlockRows::ZeroRow(int row) {
  const auto zero = [this](std::int64_t offset, int rows, int columns) {
    std::fill_n(values_.begin() + offset, QuadsOf(rows, columns) * kQuad, 0.0);
  };
  for (const Entry& entry : rows_[row]) {
    zero(entry.offset, sizes_[row], sizes_[entry.column]);
  }
  for (const int below : below_[row]) {
    zero(Find(below, row), sizes_[below], sizes_[row]);
  }
}

// All of the array, room that is free included: one pass.
void SymmetricBlockRows::Zero() {
  BestKernels().set_zero(static_cast<std::int64_t>(values_.size()), values_.data());
}

// For solvers that know nothing of edits: the living rows, renumbered without gaps. Kept until a
// block or a row has come or gone. The values stay where they are, and value_begin tells where.
const BlockPattern& SymmetricBlockRows::Pattern() const {
  if (pattern_version_ == version_) {
    return pattern_;
  }
  pattern_version_ = version_;
  pattern_.padded = true;
  pattern_.offsets.assign(1, 0);
  pattern_.row_begin.assign(1, 0);
  pattern_.columns.clear();
  pattern_.value_begin.clear();
  pattern_.groups.clear();
  pattern_rows_.clear();
  std::vector<int> place(num_rows(), -1);
  for (int row = 0; row < num_rows(); ++row) {
    if (sizes_[row] == 0) {
      continue;
    }
    place[row] = static_cast<int>(pattern_rows_.size());
    pattern_rows_.push_back(row);
    if (has_groups()) {
      pattern_.groups.push_back(group_of(row));
    }
    pattern_.offsets.push_back(pattern_.offsets.back() + sizes_[row]);
    for (const Entry& entry : rows_[row]) {
      // A block's column is at most its row, so its place is known by now, and order is kept.
      pattern_.columns.push_back(place[entry.column]);
      pattern_.value_begin.push_back(entry.offset);
    }
    pattern_.row_begin.push_back(static_cast<int>(pattern_.columns.size()));
  }
  pattern_.value_begin.push_back(static_cast<std::int64_t>(values_.size()));
  return pattern_;
}

// Lists of rows are counted as they grow (GrowthCount), which spares a pass over all rows here.
std::int64_t SymmetricBlockRows::Bytes() const {
  std::size_t bytes =
      values_.capacity() * sizeof(double) + pattern_.value_begin.capacity() * sizeof(std::int64_t);
  const std::initializer_list<const std::vector<int>*> lists = {
      &pattern_.offsets, &pattern_.row_begin, &pattern_.columns,
      &pattern_.groups,  &pattern_rows_,      &groups_};
  for (const std::vector<int>* list : lists) {
    bytes += list->capacity() * sizeof(int);
  }
  bytes += rows_.size() * sizeof(std::vector<Entry>) + below_.size() * sizeof(std::vector<int>);
  return static_cast<std::int64_t>(bytes + list_bytes_);
}

// A search among the row's blocks, and where there is none an insertion into both sorted lists.
std::int64_t SymmetricBlockRows::FindOrAdd(int row, int column) {
  auto& entries = rows_[row];
  const auto entry = std::lower_bound(entries.begin(), entries.end(), column, BeforeColumn);
  if (entry != entries.end() && entry->column == column) {
    return entry->offset;
  }
  ++version_;
  // The array may move here: pointers from values() do not survive, offsets do.
  const std::int64_t offset = Allocate(sizes_[row], sizes_[column]);
  std::vector<int>& below = below_[column];
  const GrowthCount of_row(entries, &list_bytes_);
  const GrowthCount of_column(below, &list_bytes_);
  entries.insert(entry, {column, offset});
  below.insert(std::lower_bound(below.begin(), below.end(), row), row);
  return offset;
}

// Both lists lose it, and its room waits for a block of the same length.
void SymmetricBlockRows::RemoveBlock(int row, int column) {
  ++version_;
  auto& entries = rows_[row];
  const auto entry = std::lower_bound(entries.begin(), entries.end(), column, BeforeColumn);
  Release(entry->offset, sizes_[row], sizes_[column]);
  entries.erase(entry);
  std::vector<int>& below = below_[column];
  below.erase(std::lower_bound(below.begin(), below.end(), row));
}

// A binary search among the row's blocks; row ≥ column, for the upper triangle has no values.
std::int64_t SymmetricBlockRows::Find(int row, int column) const {
  const auto& entries = rows_[row];
  const auto entry = std::lower_bound(entries.begin(), entries.end(), column, BeforeColumn);
  return entry != entries.end() && entry->column == column ? entry->offset : -1;
}

// Padding is zeroed with the rest, and kernels that add whole quads keep it zero. Room grows as
// that of a vector does, so a block costs constant time on average.
std::int64_t SymmetricBlockRows::Allocate(int rows, int columns) {
  const std::size_t quads = QuadsOf(rows, columns);
  // Room of the same length is taken up first, and zeroed: a window that slides does not grow.
  // Blocks of unlike shape may have the same length, which is all that counts.
  if (quads < free_.size() && !free_[quads].empty()) {
    const std::int64_t offset = free_[quads].back();
    free_[quads].pop_back();
    std::fill_n(values_.begin() + offset, quads * kQuad, 0.0);
    return offset;
  }
  const auto offset = static_cast<std::int64_t>(values_.size());
  values_.resize(values_.size() + quads * kQuad, 0.0);
  return offset;
}

// What was released last is given out first.
void SymmetricBlockRows::Release(std::int64_t offset, int rows, int columns) {
  ++num_released_;
  const std::size_t quads = QuadsOf(rows, columns);
  if (quads >= free_.size()) {
    free_.resize(quads + 1);
  }
  free_[quads].push_back(offset);
}

}  // namespace inceres::internal

namespace inceres {

// The half of ReducedMatrix that knows S as it grows. A pattern of it numbers living rows without
// gaps; ids are the numbers that rows have for good.

int ReducedMatrix::RowId(int i) const {
  return rows_ == nullptr ? i : rows_->pattern_rows()[i];
}

const BlockPattern& ReducedMatrix::GrownPattern() const {
  return rows_->Pattern();
}

const double* ReducedMatrix::GrownBlock(int i, int k) const {
  const BlockPattern& blocks = rows_->Pattern();
  // A held row keeps its place in the pattern, as a row of the identity: its blocks are not shown.
  const bool left_out = constant_ != nullptr &&
                        (constant_[RowId(i)] != 0 || constant_[RowId(blocks.columns[k])] != 0);
  return left_out ? nullptr : rows_->values(blocks.value_begin[k]);
}

}  // namespace inceres
