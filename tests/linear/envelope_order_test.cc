// Orders for the envelope: permutations with the newest rows last, cheaper where the order of
// arrival has aged.
#include "linear/envelope_order.h"

#include <algorithm>

#include <gtest/gtest.h>

#include "linear/growing_system.h"

namespace inceres::internal {
namespace {

// The newest rows last.
std::vector<int> Reordered(const SymmetricBlockRows& S, int num_newest) {
  const RowOrder arrival = ArrivalOrder(S);
  EnvelopeOrdering ordering;
  return ordering.Reorder(S, arrival, 0, {arrival.rows().end() - num_newest, arrival.rows().end()});
}

double Flops(const SymmetricBlockRows& S, const std::vector<int>& tail) {
  RowOrder order = ArrivalOrder(S);
  order.SetTail(tail);
  return EnvelopeFlops(S, nullptr, order, 0);
}

TEST(EnvelopeOrder, IsAPermutationOfTheRowsWithTheNewestLast) {
  for (unsigned seed = 0; seed < 10; ++seed) {
    GrowingSystem system(seed);
    for (int i = 0; i < 60; ++i) {
      system.AddRow(1 + i % 7, 2, i % 5 == 0);
    }
    for (const int row : {0, 30, 57}) {
      system.RemoveRow(row);
    }
    const std::vector<int> order = Reordered(system.S, 4);
    ASSERT_EQ(order.size(), 57u);
    EXPECT_EQ(std::vector<int>(order.end() - 4, order.end()), (std::vector<int>{55, 56, 58, 59}));
    std::vector<int> sorted = order;
    std::sort(sorted.begin(), sorted.end());
    EXPECT_EQ(std::unique(sorted.begin(), sorted.end()), sorted.end());
    EXPECT_TRUE(std::all_of(order.begin(), order.end(),
                            [&](int row) { return system.S.size_of(row) > 0; }));
  }
}

TEST(EnvelopeOrder, LeavesAPathAsItIs) {
  GrowingSystem system(1);
  for (int i = 0; i < 100; ++i) {
    system.AddRow(6, 1, false);
  }
  EXPECT_EQ(Reordered(system.S, 3), ArrivalOrder(system.S).rows());
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
  const double arrival = Flops(system.S, ArrivalOrder(system.S).rows());
  const double folded = Flops(system.S, Reordered(system.S, 5));
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
  const std::vector<int> order = Reordered(system.S, 2);
  EXPECT_EQ(order.back(), 0);
  EXPECT_EQ(order[398], 399);
  EXPECT_LT(Flops(system.S, order), 0.05 * Flops(system.S, ArrivalOrder(system.S).rows()));
}

TEST(EnvelopeOrder, TakesEveryComponent) {
  GrowingSystem system(1);
  for (int i = 0; i < 10; ++i) {
    system.AddRow(2, 0, false);
  }
  system.Couple(5, 1);
  system.Couple(9, 2);
  EXPECT_EQ(Reordered(system.S, 1), (std::vector<int>{0, 3, 4, 1, 5, 6, 7, 8, 2, 9}));
  EXPECT_TRUE(Reordered(SymmetricBlockRows(), 0).empty());
}

// Rows before the first place keep theirs, and what is put last is last.
TEST(EnvelopeOrder, OfTheTailAlone) {
  GrowingSystem system(3);
  for (int i = 0; i < 40; ++i) {
    system.AddRow(3, 3, i % 9 == 0);
  }
  RowOrder order = ArrivalOrder(system.S);
  EnvelopeOrdering ordering;
  order.SetTail(ordering.Reorder(system.S, order, 15, {4, 30, 20}));
  ASSERT_EQ(order.num_places(), 40);
  for (int place = 0; place < 15; ++place) {
    EXPECT_EQ(order.row(place), place);
  }
  EXPECT_EQ(order.row(38), 20);
  EXPECT_EQ(order.row(39), 30);
  for (int row = 0; row < 40; ++row) {
    EXPECT_EQ(order.row(order.place(row)), row);
  }
}

// A count in another order is that of the matrix with its rows in that order.
TEST(EnvelopeFlops, FollowsTheOrder) {
  GrowingSystem system(4);
  for (int i = 0; i < 30; ++i) {
    system.AddRow(2, 2, i % 6 == 0);
  }
  const std::vector<int> order = Reordered(system.S, 2);
  SymmetricBlockRows permuted;
  for (int i = 0; i < 30; ++i) {
    permuted.AddRow(2);
    for (int j = 0; j < i; ++j) {
      const int row =
          std::max(order[static_cast<std::size_t>(i)], order[static_cast<std::size_t>(j)]);
      const int column =
          std::min(order[static_cast<std::size_t>(i)], order[static_cast<std::size_t>(j)]);
      if (system.S.Find(row, column) >= 0) {
        permuted.FindOrAdd(i, j);
      }
    }
  }
  EXPECT_EQ(Flops(system.S, order), EnvelopeFlops(permuted, nullptr, ArrivalOrder(permuted), 0));
}

// With a count made by hand: two rows of size 2, coupled.
TEST(EnvelopeFlops, AddUpOverTheRows) {
  GrowingSystem pair(1);
  pair.AddRow(2, 0, false);
  pair.AddRow(2, 1, false);
  // Triangles 2³/2 each, the solve against the first 2·2·2, the update of the second 2·2·2.
  EXPECT_EQ(EnvelopeFlops(pair.S, nullptr, ArrivalOrder(pair.S), 0), 4.0 + 8.0 + 8.0 + 4.0);
  for (unsigned seed = 0; seed < 5; ++seed) {
    GrowingSystem system(seed);
    for (int i = 0; i < 50; ++i) {
      system.AddRow(1 + i % 7, 3, i % 8 == 0);
    }
    system.RemoveRow(20);
    const RowOrder order = ArrivalOrder(system.S);
    const double all = EnvelopeFlops(system.S, nullptr, order, 0);
    double sum = 0.0;
    for (int i = 0; i < order.num_places(); ++i) {
      sum += EnvelopeFlops(system.S, nullptr, order, i) -
             EnvelopeFlops(system.S, nullptr, order, i + 1);
    }
    EXPECT_EQ(all, sum);
    system.held.assign(50, 1);
    EXPECT_LT(EnvelopeFlops(system.S, system.held.data(), order, 0), 0.2 * all);
  }
}

}  // namespace
}  // namespace inceres::internal
