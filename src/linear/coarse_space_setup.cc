// What a coarse space finds out once: where its blocks are.
#include <algorithm>
#include <numeric>
#include <vector>

#include "linear/coarse_space.h"
#include "simd/kernels.h"

namespace inceres::internal {

// V has one block a row of A, in the columns of the row's aggregate: rows of widths[aggregate]
// entries, padded to quads. The members of each aggregate are listed, ascending, for the sums VᵀA
// V.
void CoarseSpace::PlaceValues() {
  const int num_rows = static_cast<int>(offsets_.size()) - 1;
  padded_.push_back(0);
  V_begin_.push_back(0);
  members_begin_.assign(shape_.num_aggregates() + 1, 0);
  for (int i = 0; i < num_rows; ++i) {
    const int aggregate = shape_.aggregate_of[i];
    ++members_begin_[aggregate + 1];
    // Vectors begin each block row on a quad.
    padded_.push_back(padded_.back() + PadToQuad(block_size(i)));
    V_begin_.push_back(V_begin_.back() +
                       static_cast<std::int64_t>(block_size(i)) * stride(aggregate));
  }
  std::partial_sum(members_begin_.begin(), members_begin_.end(), members_begin_.begin());
  members_.resize(num_rows);
  // Rows are met in ascending order, and so are the members of each aggregate.
  std::vector<int> next(members_begin_.begin(), members_begin_.end() - 1);
  for (int i = 0; i < num_rows; ++i) {
    members_[next[shape_.aggregate_of[i]]++] = i;
  }
  // Zeros also in the padding, which nobody writes.
  V_ = ZeroedArray(V_begin_.back());
}

// A V has a block where the columns of an aggregate reach a row of A: by aggregate, as it is
// formed, and once more by row, since a product A V q is summed row by row, each by one task.
void CoarseSpace::PlaceProducts() {
  const int num_rows = static_cast<int>(offsets_.size()) - 1;
  A_V_begin_.push_back(0);
  rows_begin_.assign(num_rows + 1, 0);
  for (int a = 0; a < shape_.num_aggregates(); ++a) {
    for (int place = shape_.coupled_begin[a]; place < shape_.coupled_begin[a + 1]; ++place) {
      const int row = shape_.coupled[place];
      ++rows_begin_[row + 1];
      A_V_begin_.push_back(A_V_begin_.back() +
                           static_cast<std::int64_t>(block_size(row)) * stride(a));
    }
  }
  std::partial_sum(rows_begin_.begin(), rows_begin_.end(), rows_begin_.begin());
  rows_.resize(shape_.coupled.size());
  std::vector<int> next(rows_begin_.begin(), rows_begin_.end() - 1);
  for (int a = 0; a < shape_.num_aggregates(); ++a) {
    for (int place = shape_.coupled_begin[a]; place < shape_.coupled_begin[a + 1]; ++place) {
      // By ascending aggregate within a row: one order of the sum.
      rows_[next[shape_.coupled[place]]++] = {a, place};
    }
  }
  A_V_ = ZeroedArray(A_V_begin_.back());
}

// Block (a, b) is there if a row of aggregate a is reached by the columns of b.
void CoarseSpace::BuildPattern() {
  const int count = shape_.num_aggregates();
  std::vector<std::vector<int>> columns(count);  // per row, ascending
  std::vector<int> last_column(count, -1);
  for (int b = 0; b < count; ++b) {
    for (int place = shape_.coupled_begin[b]; place < shape_.coupled_begin[b + 1]; ++place) {
      // Of the lower triangle alone. The rows come in any order of aggregates, but those of one
      // column b are met together, so the last column of a row tells whether (a, b) is new.
      const int a = shape_.aggregate_of[shape_.coupled[place]];
      if (a > b && last_column[a] != b) {
        columns[a].push_back(b);
        last_column[a] = b;
      }
    }
    // The diagonal block is always there, and last of those up to b, as a BlockPattern has it. Rows
    // behind b get theirs when the loop comes to them.
    columns[b].push_back(b);
  }
  pattern_.offsets.push_back(0);
  pattern_.row_begin.push_back(0);
  pattern_.value_begin.push_back(0);
  column_begin_.assign(count + 1, 0);
  for (int a = 0; a < count; ++a) {
    pattern_.offsets.push_back(pattern_.offsets.back() + shape_.widths[a]);
    for (const int b : columns[a]) {
      ++column_begin_[b + 1];
      pattern_.columns.push_back(b);
      pattern_.value_begin.push_back(pattern_.value_begin.back() +
                                     static_cast<std::int64_t>(shape_.widths[a]) *
                                         shape_.widths[b]);
    }
    pattern_.row_begin.push_back(static_cast<int>(pattern_.columns.size()));
  }
  FindColumns();
  // All that is coarse is packed by aggregate.
  values_.resize(static_cast<std::size_t>(pattern_.value_begin.back()));
  for (std::vector<double>* vector : {&diagonal_, &restricted_, &q_, &correction_}) {
    vector->resize(pattern_.size());
  }
}

// The blocks of VᵀA V by columns: a column is formed by one task, from A V of its aggregate.
void CoarseSpace::FindColumns() {
  const int count = shape_.num_aggregates();
  std::partial_sum(column_begin_.begin(), column_begin_.end(), column_begin_.begin());
  column_blocks_.resize(pattern_.columns.size());
  std::vector<int> next(column_begin_.begin(), column_begin_.end() - 1);
  for (int a = 0; a < count; ++a) {
    for (int k = pattern_.row_begin[a]; k < pattern_.row_begin[a + 1]; ++k) {
      column_blocks_[next[pattern_.columns[k]]++] = {a, k};
    }
  }
}

}  // namespace inceres::internal
