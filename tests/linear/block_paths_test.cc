// Which rows of S form paths.
#include "linear/block_paths.h"

#include <algorithm>
#include <set>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "linear/random_system.h"

namespace inceres::internal {
namespace {

using Pairs = std::set<std::pair<int, int>>;

Pairs Chain(int first, int last) {
  Pairs pairs;
  for (int i = first + 1; i <= last; ++i) {
    pairs.emplace(i, i - 1);
  }
  return pairs;
}

BlockPaths Find(const std::vector<int>& sizes, const Pairs& coupled) {
  return FindBlockPaths(RandomSystem(sizes, coupled).pattern);
}

std::vector<int> NodesOf(const BlockPaths& found, std::size_t path) {
  return {found.nodes.begin() + found.paths[path].begin,
          found.nodes.begin() + found.paths[path].end};
}

TEST(BlockPaths, AChainIsOneWithoutEnds) {
  const BlockPaths found = Find(std::vector<int>(5, 3), Chain(0, 4));
  ASSERT_EQ(found.paths.size(), 1u);
  EXPECT_EQ(found.nodes.size(), 5u);
  EXPECT_EQ(found.paths[0].anchor, BlockPaths::kNone);
  EXPECT_EQ(found.paths[0].next, BlockPaths::kNone);
  EXPECT_EQ(found.paths[0].size, 3);
}

TEST(BlockPaths, LoopsCutAChain) {
  Pairs coupled = Chain(0, 9);
  coupled.emplace(7, 2);
  const BlockPaths found = Find(std::vector<int>(10, 6), coupled);
  // 0, 1 end at 2; 3 to 6 are between 2 and 7; 8, 9 end at 7.
  ASSERT_EQ(found.paths.size(), 3u);
  EXPECT_EQ(NodesOf(found, 0), (std::vector<int>{0, 1}));
  EXPECT_EQ(found.paths[0].anchor, BlockPaths::kNone);
  EXPECT_EQ(found.paths[0].next, 2);
  std::vector<int> between = NodesOf(found, 1);
  const std::set<int> ends{found.paths[1].anchor, found.paths[1].next};
  EXPECT_EQ(ends, (std::set<int>{2, 7}));
  EXPECT_EQ(between.front(), found.paths[1].anchor == 2 ? 3 : 6);
  std::sort(between.begin(), between.end());
  EXPECT_EQ(between, (std::vector<int>{3, 4, 5, 6}));
  EXPECT_EQ(NodesOf(found, 2), (std::vector<int>{9, 8}));
  EXPECT_EQ(found.paths[2].next, 7);
}

TEST(BlockPaths, RowsThatKnowTheSameAreANode) {
  // A pose is a position and a rotation, each coupled to both of the next pose.
  Pairs coupled;
  for (int pose = 0; pose < 6; ++pose) {
    coupled.emplace(2 * pose + 1, 2 * pose);
    for (int a = 0; a < 2 && pose > 0; ++a) {
      for (int b = 0; b < 2; ++b) {
        coupled.emplace(2 * pose + a, 2 * pose - 2 + b);
      }
    }
  }
  const BlockPaths found = Find(std::vector<int>(12, 3), coupled);
  EXPECT_EQ(found.num_nodes(), 6);
  ASSERT_EQ(found.paths.size(), 1u);
  EXPECT_EQ(found.paths[0].size, 6);
  EXPECT_EQ(found.nodes.size(), 6u);
}

TEST(BlockPaths, ARingIsHeldTogetherByANode) {
  Pairs coupled = Chain(0, 5);
  coupled.emplace(5, 0);
  const BlockPaths found = Find(std::vector<int>(6, 3), coupled);
  ASSERT_EQ(found.paths.size(), 1u);
  EXPECT_EQ(found.nodes.size(), 5u);
  EXPECT_EQ(found.paths[0].anchor, found.paths[0].next);
  EXPECT_EQ(std::count(found.nodes.begin(), found.nodes.end(), found.paths[0].next), 0);
}

TEST(BlockPaths, OtherSizesAndLargeBlocksEndPaths) {
  std::vector<int> sizes(9, 3);
  sizes[4] = 2;
  const BlockPaths found = Find(sizes, Chain(0, 8));
  for (std::size_t p = 0; p < found.paths.size(); ++p) {
    const std::vector<int> nodes = NodesOf(found, p);
    EXPECT_EQ(std::count_if(nodes.begin(), nodes.end(), [](int n) { return n >= 3 && n <= 5; }), 0);
  }
  EXPECT_EQ(found.nodes.size(), 6u);
  EXPECT_TRUE(Find(std::vector<int>(6, 9), Chain(0, 5)).paths.empty());
}

}  // namespace
}  // namespace inceres::internal
