// What coarse columns find out once: where their blocks are.
#include <utility>
#include <vector>

#include "base/counting_sort.h"
#include "linear/coarse_columns.h"
#include "linear/pattern_rows.h"
#include "simd/kernels.h"

namespace inceres::internal {

CoarseColumns::CoarseColumns(const std::vector<int>& offsets, CoarseShape shape,
                             const Executor& executor)
    : executor_(executor), shape_(std::move(shape)), offsets_(offsets), column_offsets_{0} {
  for (const int width : shape_.widths) {
    column_offsets_.push_back(column_offsets_.back() + width);
  }
  PlaceValues();
  PlaceProducts();
}

// V has one block a row of A, in the columns of the row's aggregate: rows of widths[aggregate]
// entries, padded to quads. The members of each aggregate are listed, ascending, for the sums VᵀA
// V.
void CoarseColumns::PlaceValues() {
  padded_.push_back(0);
  V_begin_.push_back(0);
  for (int i = 0; i < num_rows(); ++i) {
    // Vectors begin each block row on a quad.
    padded_.push_back(padded_.back() + PadToQuad(block_size(i)));
    V_begin_.push_back(V_begin_.back() +
                       static_cast<std::int64_t>(block_size(i)) * stride(shape_.aggregate_of[i]));
  }
  const auto for_each_member = [this](const auto& add) {
    for (int i = 0; i < num_rows(); ++i) {
      add(shape_.aggregate_of[i], i);
    }
  };
  CountingSort(shape_.num_aggregates(), for_each_member, &members_begin_, &members_);
  // Zeros also in the padding, which nobody writes.
  V_ = ZeroedArray(V_begin_.back());
}

// A V has a block where the columns of an aggregate reach a row of A: by aggregate, as it is
// formed, and once more by row, since a product A V q is summed row by row, each by one task.
void CoarseColumns::PlaceProducts() {
  A_V_begin_.push_back(0);
  const auto for_each_product = [this](const auto& add) {
    for (int a = 0; a < shape_.num_aggregates(); ++a) {
      for (int place = shape_.coupled_begin[a]; place < shape_.coupled_begin[a + 1]; ++place) {
        add(shape_.coupled[place], RowPlace{a, place});
      }
    }
  };
  for_each_product([this](int row, const RowPlace& place) {
    A_V_begin_.push_back(A_V_begin_.back() +
                         static_cast<std::int64_t>(block_size(row)) * stride(place.aggregate));
  });
  // By ascending aggregate within a row: one order of the sum.
  CountingSort(num_rows(), for_each_product, &rows_begin_, &rows_);
  A_V_ = ZeroedArray(A_V_begin_.back());
}

// Block (a, b) is there if a row of aggregate a is reached by the columns of b.
BlockPattern CoarseColumns::GalerkinPattern() const {
  const int count = shape_.num_aggregates();
  std::vector<std::vector<int>> columns(count);  // per row, ascending
  std::vector<int> last_column(count, -1);
  for (int b = 0; b < count; ++b) {
    for (int place = shape_.coupled_begin[b]; place < shape_.coupled_begin[b + 1]; ++place) {
      // Of the lower triangle alone. The rows come in any order of aggregates, but those of one
      // column b are met together, so the last column of a row tells whether (a, b) is new.
      const int a = shape_.aggregate_of[shape_.coupled[place]];
      if (a > b && std::exchange(last_column[a], b) != b) {
        columns[a].push_back(b);
      }
    }
    // The diagonal block is always there, and last of those up to b, as a BlockPattern has it. Rows
    // behind b get theirs when the loop comes to them.
    columns[b].push_back(b);
  }
  BlockPattern pattern = PatternWithoutBlocks(column_offsets_);
  for (const std::vector<int>& of_row : columns) {
    AppendRow(of_row, &pattern);
  }
  return pattern;
}

}  // namespace inceres::internal
