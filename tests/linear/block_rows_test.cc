// The pattern that SymmetricBlockRows keeps, against a set of pairs, as solvers see it too, and
// that removed blocks come back as zeros.
#include "linear/block_rows.h"

#include <algorithm>
#include <iterator>
#include <set>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "support/random_values.h"

namespace inceres::internal {
namespace {

class BlockRowsTest : public testing::Test {
 protected:
  void AddRow() {
    const int size = 1 + random_.Below(7);
    const auto dead =
        static_cast<int>(std::find(alive_.begin(), alive_.end(), false) - alive_.begin());
    if (dead < S_.num_rows()) {
      S_.ReviveRow(dead, size);
      alive_[static_cast<std::size_t>(dead)] = true;
    } else {
      EXPECT_EQ(S_.AddRow(size), dead);
      alive_.push_back(true);
    }
    Fill(dead, dead);
  }

  void Couple(int a, int b) {
    const auto [column, row] = std::minmax(a, b);
    if (S_.size_of(row) == 0 || S_.size_of(column) == 0) {
      return;
    }
    Fill(row, column);
  }

  // A block is zero when it is new; afterwards it is 1.
  void Fill(int row, int column) {
    double* block = S_.values(S_.FindOrAdd(row, column));
    const int count = S_.size_of(row) * PadToQuad(S_.size_of(column));
    if (pattern_.insert({row, column}).second) {
      EXPECT_EQ(std::count(block, block + count, 0.0), count) << row << ", " << column;
    }
    std::fill_n(block, count, 1.0);
  }

  // Takes the row's first block away, if it is not the diagonal one.
  void Uncouple(int row) {
    if (S_.row(row).size() > 1) {
      const int column = S_.row(row).front().column;
      S_.RemoveBlock(row, column);
      pattern_.erase({row, column});
    }
  }

  void RemoveRow(int row) {
    S_.RemoveRow(row);
    alive_[static_cast<std::size_t>(row)] = false;
    for (auto at = pattern_.begin(); at != pattern_.end();) {
      at = at->first == row || at->second == row ? pattern_.erase(at) : std::next(at);
    }
  }

  void ExpectPattern() const {
    std::vector<std::vector<int>> left(alive_.size());
    std::vector<std::vector<int>> below(alive_.size());
    for (const auto& [row, column] : pattern_) {  // by row, then by column
      left[static_cast<std::size_t>(row)].push_back(column);
      if (row != column) {
        below[static_cast<std::size_t>(column)].push_back(row);
      }
    }
    ASSERT_EQ(S_.num_rows(), static_cast<int>(alive_.size()));
    for (int row = 0; row < S_.num_rows(); ++row) {
      std::vector<int> columns;
      for (const SymmetricBlockRows::Entry& entry : S_.row(row)) {
        columns.push_back(entry.column);
        EXPECT_EQ(entry.offset, S_.Find(row, entry.column));
      }
      ASSERT_EQ(columns, left[static_cast<std::size_t>(row)]) << row;
      ASSERT_EQ(S_.below(row), below[static_cast<std::size_t>(row)]) << row;
    }
  }

  // The pattern is that of the rows which are there, over the same values; of held ones a view
  // leaves out the blocks.
  void ExpectView() {
    const std::vector<double> diagonal(2000, 1.0);
    std::vector<char> held(alive_.size());
    std::generate(held.begin(), held.end(),
                  [this] { return static_cast<char>(random_.Below(4) == 0); });
    const ReducedMatrix A(S_, diagonal.data(), held.data());
    const BlockPattern& pattern = A.pattern();
    ASSERT_EQ(pattern.num_blocks(), std::count(alive_.begin(), alive_.end(), true));
    auto expected = pattern_.begin();
    int offset = 0;
    for (int i = 0; i < pattern.num_blocks(); ++i) {
      const int row = A.RowId(i);
      EXPECT_EQ(pattern.offsets[static_cast<std::size_t>(i)], offset);
      EXPECT_EQ(pattern.block_size(i), S_.size_of(row));
      offset += S_.size_of(row);
      for (int k = pattern.row_begin[static_cast<std::size_t>(i)];
           k < pattern.row_begin[static_cast<std::size_t>(i) + 1]; ++k) {
        const int column = A.RowId(pattern.columns[static_cast<std::size_t>(k)]);
        ASSERT_EQ(*expected++, std::pair(row, column));
        const bool left_out =
            held[static_cast<std::size_t>(row)] != 0 || held[static_cast<std::size_t>(column)] != 0;
        ASSERT_EQ(A.Block(i, k), left_out ? nullptr : S_.values(S_.Find(row, column)));
      }
    }
    EXPECT_EQ(expected, pattern_.end());
  }

  test::Random random_{1};
  SymmetricBlockRows S_;
  std::vector<bool> alive_;
  std::set<std::pair<int, int>> pattern_;
};

TEST_F(BlockRowsTest, KnowsItsPatternUnderRandomEdits) {
  for (int edit = 0; edit < 2000; ++edit) {
    const int kind = random_.Below(10);
    if (S_.num_rows() < 3 || (kind == 0 && pattern_.size() < 200)) {
      AddRow();
    } else if (kind == 1) {
      RemoveRow(random_.Below(S_.num_rows()));
    } else if (kind == 2) {
      Uncouple(random_.Below(S_.num_rows()));
    } else {
      Couple(random_.Below(S_.num_rows()), random_.Below(S_.num_rows()));
    }
    ASSERT_NO_FATAL_FAILURE(ExpectPattern()) << edit;
    if (edit % 7 == 0) {
      ASSERT_NO_FATAL_FAILURE(ExpectView()) << edit;
    }
  }
}

TEST_F(BlockRowsTest, ARowIsZeroedInTheRowsBelowToo) {
  for (int i = 0; i < 8; ++i) {
    AddRow();
  }
  for (const auto& [a, b] : {std::pair(3, 1), {5, 3}, {7, 3}, {6, 5}}) {
    Couple(a, b);
  }
  S_.ZeroRow(3);
  for (const auto& [row, column] : pattern_) {
    const double expected = row == 3 || column == 3 ? 0.0 : 1.0;
    EXPECT_EQ(S_.values(S_.Find(row, column))[0], expected) << row << ", " << column;
  }
  ExpectPattern();
}

}  // namespace
}  // namespace inceres::internal
