// The assembly tree against a Cholesky factor by hand: every entry of the factor has a place, and
// every front knows its parent.
#include "linear/front_tree.h"

#include <algorithm>
#include <map>
#include <set>
#include <utility>

#include <gtest/gtest.h>

#include "linear/random_system.h"
#include "support/suitesparse_memory.h"

namespace inceres::internal {
namespace {

using Fill = RandomSystem::Fill;

// The entries of the factor of S in this order, by blocks: row position and column position.
std::set<std::pair<int, int>> FilledBlocks(const BlockPattern& pattern,
                                           const std::vector<int>& order) {
  const int n = pattern.num_blocks();
  std::vector<int> position(static_cast<std::size_t>(n));
  for (int at = 0; at < n; ++at) {
    position[order[at]] = at;
  }
  std::vector<std::set<int>> columns(static_cast<std::size_t>(n));  // rows below the diagonal
  for (int i = 0; i < n; ++i) {
    for (int k = pattern.row_begin[i]; k < pattern.row_begin[i + 1]; ++k) {
      const auto [low, high] = std::minmax(position[i], position[pattern.columns[k]]);
      if (low != high) {
        columns[low].insert(high);
      }
    }
  }
  std::set<std::pair<int, int>> filled;
  for (int column = 0; column < n; ++column) {
    filled.emplace(column, column);
    for (const int row : columns[column]) {
      filled.emplace(row, column);
      if (row != *columns[column].begin()) {
        columns[*columns[column].begin()].insert(row);
      }
    }
  }
  return filled;
}

struct TreeCase {
  const char* name;
  RandomSystem system;
};

class FrontTreeLaws : public testing::TestWithParam<TreeCase> {
 protected:
  FrontTreeLaws() { EXPECT_TRUE(BuildFrontTree(pattern_, &tree_).ok()); }

  // The scalar rows of the order that a front's rows stand for; -1 for padding.
  std::vector<int> ScalarRows(int f) const {
    const Front& front = tree_.fronts[f];
    std::vector<int> rows(static_cast<std::size_t>(front.num_rows()), -1);
    for (int pivot = 0, at = front.position_begin; at < front.position_end; ++at) {
      for (int k = 0; k < SizeAt(at); ++k) {
        rows[pivot++] = OffsetOf(at) + k;
      }
    }
    if (front.parent >= 0) {
      const std::vector<int> parent_rows = ScalarRows(front.parent);
      for (int run = front.run_begin; run < front.run_end; ++run) {
        const auto [from, to, length] = tree_.runs[run];
        std::copy_n(parent_rows.begin() + to, length, rows.begin() + front.below() + from);
      }
    }
    return rows;
  }
  int SizeAt(int position) const { return pattern_.block_size(tree_.order[position]); }
  int OffsetOf(int position) const {
    int offset = 0;
    for (int at = 0; at < position; ++at) {
      offset += SizeAt(at);
    }
    return offset;
  }

  const BlockPattern& pattern_ = GetParam().system.pattern;
  FrontTree tree_;
};

TEST_P(FrontTreeLaws, TheOrderIsAPermutation) {
  EXPECT_EQ(std::set<int>(tree_.order.begin(), tree_.order.end()).size(),
            static_cast<std::size_t>(pattern_.num_blocks()));
}

TEST_P(FrontTreeLaws, FrontsCoverTheOrderChildrenFirst) {
  int position = 0;
  for (int f = 0; f < static_cast<int>(tree_.fronts.size()); ++f) {
    const Front& front = tree_.fronts[f];
    EXPECT_EQ(front.position_begin, position);
    EXPECT_GT(front.position_end, position);
    position = front.position_end;
    EXPECT_TRUE(front.parent > f || (front.parent == -1 && front.height == 0));
    for (int k = front.child_begin; k < front.child_end; ++k) {
      EXPECT_EQ(tree_.fronts[tree_.children[k]].parent, f);
    }
  }
  EXPECT_EQ(position, pattern_.num_blocks());
}

TEST_P(FrontTreeLaws, RowsAscendAndHoldEveryEntryOfTheFactor) {
  std::map<int, std::set<int>> rows_of_column;  // scalar positions
  for (int f = 0; f < static_cast<int>(tree_.fronts.size()); ++f) {
    const Front& front = tree_.fronts[f];
    std::vector<int> rows = ScalarRows(f);
    rows.erase(std::remove(rows.begin(), rows.end(), -1), rows.end());
    EXPECT_TRUE(std::is_sorted(rows.begin(), rows.end()));
    EXPECT_EQ(static_cast<int>(rows.size()), front.width + front.height);
    for (int pivot = 0; pivot < front.width; ++pivot) {
      rows_of_column[rows[pivot]] = std::set<int>(rows.begin(), rows.end());
    }
  }
  for (const auto& [row, column] : FilledBlocks(pattern_, tree_.order)) {
    for (int k = 0; k < SizeAt(column); ++k) {
      EXPECT_EQ(rows_of_column[OffsetOf(column) + k].count(OffsetOf(row)), 1u)
          << row << ", " << column;
    }
  }
}

TEST_P(FrontTreeLaws, EveryBlockOfSIsAPieceAtItsPlace) {
  std::set<int> seen;
  for (int f = 0; f < static_cast<int>(tree_.fronts.size()); ++f) {
    const std::vector<int> rows = ScalarRows(f);
    for (int k = tree_.fronts[f].piece_begin; k < tree_.fronts[f].piece_end; ++k) {
      const FrontPiece& piece = tree_.pieces[k];
      EXPECT_TRUE(seen.insert(piece.block).second);
      const auto i =
          std::upper_bound(pattern_.row_begin.begin(), pattern_.row_begin.end(), piece.block) -
          pattern_.row_begin.begin() - 1;
      const int j = pattern_.columns[piece.block];
      EXPECT_EQ(piece.i, i);
      const auto position = [this](long b) {
        return std::find(tree_.order.begin(), tree_.order.end(), b) - tree_.order.begin();
      };
      EXPECT_EQ(rows[piece.row], OffsetOf(static_cast<int>(position(i))));
      EXPECT_EQ(rows[piece.column], OffsetOf(static_cast<int>(position(j))));
      EXPECT_LT(std::min(piece.row, piece.column), tree_.fronts[f].width);
    }
  }
  EXPECT_EQ(seen.size(), pattern_.columns.size());
}

INSTANTIATE_TEST_SUITE_P(
    Patterns, FrontTreeLaws,
    testing::Values(TreeCase{"One", {{3}, Fill::kDense}},
                    TreeCase{"Forest", {std::vector<int>(40, 3), Fill::kDiagonal}},
                    TreeCase{"Full", {{6, 1, 15, 9, 3, 7, 33, 2}, Fill::kDense}},
                    TreeCase{"Band", {std::vector<int>(120, 6), Fill::kBand}},
                    TreeCase{"MixedBand",
                             {{6, 1, 15, 9, 3, 7, 33, 2, 6, 6, 9, 1, 1, 1, 6, 15}, Fill::kBand}},
                    TreeCase{"Path",
                             {std::vector<int>(300, 9),
                              [](int i, int j) { return i - j <= 8 || (i - j) % 90 == 0; }, 1}}),
    [](const auto& instance) { return instance.param.name; });

// A chain of small blocks: a front takes a few of them, and not as many as a wide one would hold,
// most of which are zeros. Without any joined the flops are least and the fronts too many.
TEST(FrontTree, ChainsOfPosesHaveNarrowFronts) {
  for (const int size : {3, 6}) {
    const RandomSystem chain(
        std::vector<int>(500, size), [](int i, int j) { return i - j <= 1; }, 1);
    FrontTree tree;
    ASSERT_TRUE(BuildFrontTree(chain.pattern, &tree, /*may_dissect=*/false).ok());
    int widest = 0;
    for (const Front& front : tree.fronts) {
      widest = std::max(widest, front.width);
    }
    EXPECT_LE(widest, 24) << size;
    EXPECT_LT(tree.fronts.size(), 400u) << size;
    // Of one pose by itself, with two neighbors.
    const double pose = size * (size * (size / 3.0 + 2.0 * size) + 4.0 * size * size);
    EXPECT_LT(tree.flops, 500 * 6.0 * pose) << size;
  }
}

// No fault of the matrix: not kSingular, upon which the same would be tried again with more
// damping.
TEST(FrontTree, OutOfMemoryIsSaidAndForgotten) {
  test::SuiteSparseMemory memory;
  if (!memory.IsReachable()) {
    GTEST_SKIP() << "this SuiteSparse does not let its allocator be replaced";
  }
  const RandomSystem system(std::vector<int>(100, 6), Fill::kBand);
  FrontTree tree;
  memory.Deny();
  const Status failed = BuildFrontTree(system.pattern, &tree);
  EXPECT_EQ(failed.code, StatusCode::kUnavailable);
  EXPECT_NE(failed.message.find("out of memory"), std::string::npos) << failed.message;
  memory.Grant();
  EXPECT_TRUE(BuildFrontTree(system.pattern, &tree).ok());
  EXPECT_FALSE(tree.fronts.empty());
}

}  // namespace
}  // namespace inceres::internal
