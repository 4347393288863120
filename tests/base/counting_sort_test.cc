// Items by their group, in the order in which they came.
#include "base/counting_sort.h"

#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "base/executor.h"

namespace inceres::internal {
namespace {

TEST(CountingSort, KeepsTheOrderWithinAGroup) {
  int num_walks = 0;
  const auto for_each = [&num_walks](const auto& add) {
    ++num_walks;
    add(2, std::string("a"));
    add(0, std::string("b"));
    add(2, std::string("c"));
    add(4, std::string("d"));
    add(2, std::string("e"));
  };
  std::vector<int> begin{7, 7};  // whatever was there
  std::vector<std::string> items(9, "old");
  CountingSort(5, for_each, &begin, &items);
  EXPECT_EQ(begin, (std::vector<int>{0, 1, 1, 4, 4, 5}));
  EXPECT_EQ(items, (std::vector<std::string>{"b", "a", "c", "e", "d"}));
  EXPECT_EQ(num_walks, 2) << "to count and to place";
}

TEST(CountingSort, OfNothing) {
  std::vector<int> begin;
  std::vector<int> items;
  CountingSort(
      3, [](const auto& /*add*/) {}, &begin, &items);
  EXPECT_EQ(begin, (std::vector<int>{0, 0, 0, 0}));
  EXPECT_TRUE(items.empty());
  CountingSort(
      0, [](const auto& /*add*/) {}, &begin, &items);
  EXPECT_EQ(begin, std::vector<int>{0});
}

TEST(CountingSort, IsTheSameWithSeveralThreads) {
  constexpr int kNumGroups = 7;
  constexpr int kNumItems = 100000;  // six parts
  const auto group_of = [](int item) { return (item * 31 + item / 1000) % (kNumGroups + 1) - 1; };
  std::vector<int> begin, one_begin;
  std::vector<int> items, one_items;
  CountingSort(
      kNumGroups,
      [&](const auto& add) {
        for (int i = 0; i < kNumItems; ++i) {
          if (group_of(i) >= 0) {
            add(group_of(i), i);
          }
        }
      },
      &one_begin, &one_items);
  for (const int num_threads : {1, 2, 3, 8}) {
    const Executor executor(num_threads);
    CountingSort(executor, kNumGroups, kNumItems, group_of, &begin, &items);
    EXPECT_EQ(begin, one_begin) << num_threads;
    EXPECT_EQ(items, one_items) << num_threads;
  }
  const Executor executor(2);
  CountingSort(
      executor, kNumGroups, kNumItems, [](int) { return -1; }, &begin, &items);
  EXPECT_EQ(begin, std::vector<int>(kNumGroups + 1, 0)) << "all are left out";
  EXPECT_TRUE(items.empty());
  CountingSort(executor, 0, 0, group_of, &begin, &items);
  EXPECT_EQ(begin, std::vector<int>{0});
}

}  // namespace
}  // namespace inceres::internal
