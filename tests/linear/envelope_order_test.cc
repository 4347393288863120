// Orders for the envelope: permutations with the newest rows last, cheaper where the order of arrival has aged.
#include "linear/envelope_order.h"

#include <algorithm>
#include <numeric>

#include <gtest/gtest.h>

#include "linear/growing_system.h"

namespace inceres::internal {
namespace {

std::vector<int> Arrival(const SymmetricBlockRows& S) {
  std::vector<int> order(static_cast<std::size_t>(S.num_rows()));
  std::iota(order.begin(), order.end(), 0);
  return order;
}

TEST(EnvelopeOrder, IsAPermutationOfTheLivingRowsWithTheNewestLast) {
  for (unsigned seed = 0; seed < 10; ++seed) {
    GrowingSystem system(seed);
    for (int i = 0; i < 60; ++i) {
      system.AddRow(1 + i % 7, 2, i % 5 == 0);
    }
    for (const int row : {0, 30, 57}) {
      system.RemoveRow(row);
    }
    const std::vector<int> order = EnvelopeOrder(system.S, 4);
    ASSERT_EQ(order.size(), 57u);
    EXPECT_EQ(std::vector<int>(order.end() - 4, order.end()), (std::vector<int>{55, 56, 58, 59}));
    std::vector<int> sorted = order;
    std::sort(sorted.begin(), sorted.end());
    EXPECT_EQ(std::unique(sorted.begin(), sorted.end()), sorted.end());
    EXPECT_TRUE(std::all_of(order.begin(), order.end(), [&](int row) { return system.S.size_of(row) > 0; }));
  }
}

TEST(EnvelopeOrder, LeavesAPathAsItIs) {
  GrowingSystem system(1);
  for (int i = 0; i < 100; ++i) {
    system.AddRow(6, 1, false);
  }
  EXPECT_EQ(EnvelopeOrder(system.S, 3), Arrival(system.S));
}

// A street driven there and back: each frame of the way back sees those of the way there.
TEST(EnvelopeOrder, FoldsAWayThereAndBack) {
  GrowingSystem system(1);
  for (int i = 0; i < 200; ++i) {
    system.AddRow(6, 3, false);
    if (i > 100) {
      system.Couple(i, 200 - i);
    }
  }
  const double arrival = EnvelopeFlops(system.S, Arrival(system.S));
  const double folded = EnvelopeFlops(system.S, EnvelopeOrder(system.S, 5));
  EXPECT_LT(folded, 0.05 * arrival);
}

TEST(EnvelopeOrder, ARowCoupledToAllComesLast) {
  GrowingSystem system(1);
  for (int i = 0; i < 400; ++i) {
    system.AddRow(6, 2, false);
    if (i > 0) {
      system.Couple(i, 0);
    }
  }
  const std::vector<int> order = EnvelopeOrder(system.S, 2);
  EXPECT_EQ(order.back(), 0);
  EXPECT_EQ(order[398], 399);
  EXPECT_LT(EnvelopeFlops(system.S, order), 0.05 * EnvelopeFlops(system.S, Arrival(system.S)));
}

TEST(EnvelopeOrder, TakesEveryComponent) {
  GrowingSystem system(1);
  for (int i = 0; i < 10; ++i) {
    system.AddRow(2, 0, false);
  }
  system.Couple(5, 1);
  system.Couple(9, 2);
  EXPECT_EQ(EnvelopeOrder(system.S, 1), (std::vector<int>{0, 3, 4, 1, 5, 6, 7, 8, 2, 9}));
  EXPECT_TRUE(EnvelopeOrder(SymmetricBlockRows(), 1).empty());
}

// All three ways to count agree, and with a count made by hand: two rows of size 2, coupled.
TEST(EnvelopeFlops, CountsAlike) {
  GrowingSystem pair(1);
  pair.AddRow(2, 0, false);
  pair.AddRow(2, 1, false);
  // Triangles 2³/2 each, the solve against the first 2·2·2, the update of the second 2·2·2.
  EXPECT_EQ(EnvelopeFlops(pair.S, nullptr, 0), 4.0 + 8.0 + 8.0 + 4.0);
  for (unsigned seed = 0; seed < 5; ++seed) {
    GrowingSystem system(seed);
    for (int i = 0; i < 50; ++i) {
      system.AddRow(1 + i % 7, 3, i % 8 == 0);
    }
    system.RemoveRow(20);
    const double all = EnvelopeFlops(system.S, nullptr, 0);
    EXPECT_EQ(all, EnvelopeFlops(system.S, Arrival(system.S)));
    double sum = 0.0;
    for (int i = 0; i < 50; ++i) {
      sum += EnvelopeFlops(system.S, nullptr, i) - EnvelopeFlops(system.S, nullptr, i + 1);
    }
    EXPECT_EQ(all, sum);
    system.held.assign(50, 1);
    EXPECT_LT(EnvelopeFlops(system.S, system.held.data(), 0), 0.2 * all);
  }
}

}  // namespace
}  // namespace inceres::internal
