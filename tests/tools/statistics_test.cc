#include "tools/ab/statistics.h"

#include <gtest/gtest.h>

namespace inceres::tools {
namespace {

TEST(Summarize, OddCountTakesTheMiddleValue) {
  const Spread spread = Summarize({5.0, 1.0, 3.0});
  EXPECT_EQ(spread.median, 3.0);
  EXPECT_EQ(spread.min, 1.0);
  EXPECT_EQ(spread.max, 5.0);
}

TEST(Summarize, EvenCountTakesTheMeanOfTheMiddleValues) {
  EXPECT_EQ(Summarize({4.0, 1.0, 2.0, 100.0}).median, 3.0);
}

TEST(Summarize, OneValueIsItsOwnSpread) {
  const Spread spread = Summarize({7.0});
  EXPECT_EQ(spread.median, 7.0);
  EXPECT_EQ(spread.min, 7.0);
  EXPECT_EQ(spread.max, 7.0);
}

TEST(SummarizeRatios, AreTakenRoundByRound) {
  // The machine is ten times slower in the second round: the ratio of medians would be 2 / 2, the
  // ratios of rounds show 1/2.
  const Spread ratio = SummarizeRatios({1.0, 10.0, 2.0}, {2.0, 20.0, 2.0});
  EXPECT_EQ(ratio.median, 0.5);
  EXPECT_EQ(ratio.min, 0.5);
  EXPECT_EQ(ratio.max, 1.0);
}

TEST(MedianOrNever, NeverIsLaterThanAnyNumber) {
  EXPECT_EQ(MedianOrNever({std::nullopt, 1.0, 3.0}), 3.0);
  EXPECT_EQ(MedianOrNever({2.0, 1.0, 3.0}), 2.0);
  EXPECT_EQ(MedianOrNever({std::nullopt, std::nullopt, 3.0}), std::nullopt);
  EXPECT_EQ(MedianOrNever({std::nullopt, 3.0}), std::nullopt);
  EXPECT_EQ(MedianOrNever({}), std::nullopt);
}

}  // namespace
}  // namespace inceres::tools
