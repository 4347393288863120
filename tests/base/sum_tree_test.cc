// A sum of numbers of which few change at a time.
#include "base/sum_tree.h"

#include <cmath>
#include <cstdint>
#include <cstring>
#include <random>
#include <vector>

#include <gtest/gtest.h>

namespace inceres::internal {
namespace {

std::uint64_t BitsOf(double value) {
  std::uint64_t bits = 0;
  std::memcpy(&bits, &value, sizeof bits);
  return bits;
}

// Of numbers that come one by one and never change.
double Fresh(const std::vector<double>& numbers) {
  SumTree tree;
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    tree.Grow(i + 1);
    tree.Set(static_cast<std::int32_t>(i), numbers[i]);
  }
  return tree.sum();
}

TEST(SumTree, BitsAreThoseOfTheNumbersWhateverTheyWereBefore) {
  std::mt19937 random(3);
  SumTree tree;
  std::vector<double> numbers;
  for (int round = 0; round < 300; ++round) {
    std::vector<std::int32_t> changed;
    for (std::size_t i = 0; i < numbers.size(); ++i) {
      if (random() % 4 == 0) {
        changed.push_back(static_cast<std::int32_t>(i));
      }
    }
    for (auto come = random() % 3; come > 0; --come) {
      changed.push_back(static_cast<std::int32_t>(numbers.size()));
      numbers.push_back(0.0);
    }
    tree.Grow(numbers.size());
    const auto draw = [&](std::int32_t i) {
      return numbers[static_cast<std::size_t>(i)] =
                 std::ldexp(static_cast<double>(random()), static_cast<int>(random() % 60) - 60);
    };
    if (round % 2 == 0) {
      tree.Set(changed, draw);
    } else {
      for (const std::int32_t i : changed) {
        tree.Set(i, draw(i));
      }
    }
    ASSERT_EQ(BitsOf(tree.sum()), BitsOf(Fresh(numbers))) << round;
    for (std::size_t i = 0; i < numbers.size(); ++i) {
      ASSERT_EQ(tree[static_cast<std::int32_t>(i)], numbers[i]);
    }
  }
  EXPECT_GT(numbers.size(), 200U);
}

TEST(SumTree, WhatWasInfiniteOrNoNumberLeavesNothingBehind) {
  SumTree tree;
  EXPECT_EQ(tree.sum(), 0.0);
  tree.Grow(5);
  tree.Set(3, 2.0);
  tree.Set(1, HUGE_VAL);
  tree.Set(2, std::nan(""));
  EXPECT_TRUE(std::isnan(tree.sum()));
  tree.Set({1, 2}, [](std::int32_t i) { return static_cast<double>(i); });
  EXPECT_EQ(tree.sum(), 5.0);
}

}  // namespace
}  // namespace inceres::internal
