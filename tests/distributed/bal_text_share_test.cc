// Stretches of a BAL text that are read by themselves: together they are the file, wherever it is
// cut.
#include "tools/distributed/bal_text_share.h"

#include <algorithm>
#include <cstdint>
#include <string>

#include <gtest/gtest.h>

#include "inceres/io/bal.h"
#include "support/temp_dir.h"

namespace inceres::tools {
namespace {

BalProblem SmallProblem() {
  BalProblem bal;
  bal.num_cameras = 3;
  bal.num_points = 7;
  for (int i = 0; i < 15; ++i) {
    bal.observations.push_back({i % 3, i % 7, 1.0 / (i + 1), -0.37 * i});
  }
  for (int i = 0; i < 9 * bal.num_cameras; ++i) {
    bal.cameras.push_back(i / 7.0);
  }
  for (int i = 0; i < 3 * bal.num_points; ++i) {
    bal.points.push_back(-1e-9 * i);
  }
  return bal;
}

// Cut in the middle of numbers too.
TEST(BalTextShare, SharesTogetherAreAll) {
  const test::TempDir dir;
  BalProblem joined = SmallProblem();
  const std::string path = dir.File("a.txt");
  ASSERT_TRUE(WriteBal(path, joined).ok());
  const std::string text = test::ReadBytes(path);
  const auto bytes = static_cast<std::int64_t>(text.size());
  for (std::int64_t cut = 0; cut <= bytes; ++cut) {
    joined.observations.clear();
    joined.cameras.clear();
    joined.points.clear();
    internal::BalCounts counts;
    std::int64_t file_bytes = 0;
    ASSERT_TRUE(ReadBalCounts(path, &counts, &file_bytes));
    EXPECT_EQ(file_bytes, bytes);
    const std::int64_t cuts[] = {0, cut, std::min(cut + 3, bytes), bytes};
    std::int64_t first = 0;
    for (int k = 0; k < 3; ++k) {
      std::int64_t num_tokens = 0;
      internal::BalShare share;
      ASSERT_TRUE(CountTokens(path, cuts[k], cuts[k + 1], &num_tokens));
      ASSERT_TRUE(ReadBalShare(path, counts, cuts[k], first, num_tokens, &share)) << cut;
      first += num_tokens;
      if (!share.observations.empty()) {
        EXPECT_EQ(share.first_observation, static_cast<std::int64_t>(joined.observations.size()));
      }
      joined.observations.insert(joined.observations.end(), share.observations.begin(),
                                 share.observations.end());
      joined.cameras.insert(joined.cameras.end(), share.cameras.begin(), share.cameras.end());
      joined.points.insert(joined.points.end(), share.points.begin(), share.points.end());
    }
    EXPECT_EQ(first, NumTokens(counts));
    ASSERT_TRUE(WriteBal(dir.File("joined.txt"), joined).ok());
    EXPECT_EQ(test::ReadBytes(dir.File("joined.txt")), text) << cut;
  }
}

TEST(BalTextShare, WhatIsWrongIsRefused) {
  const test::TempDir dir;
  const std::string path = dir.File("a.txt");
  ASSERT_TRUE(WriteBal(path, SmallProblem()).ok());
  internal::BalCounts counts;
  std::int64_t value = 0;
  EXPECT_FALSE(ReadBalCounts(dir.File("missing.txt"), &counts, &value));
  EXPECT_FALSE(CountTokens(dir.File("missing.txt"), 0, 1, &value));
  ASSERT_TRUE(ReadBalCounts(path, &counts, &value));
  internal::BalShare share;
  counts.num_cameras = 2;  // indices of cameras reach 2
  EXPECT_FALSE(ReadBalShare(path, counts, 0, 0, NumTokens(counts), &share));
}

}  // namespace
}  // namespace inceres::tools
