// Items by their group, in the order in which they came.
#include "base/counting_sort.h"

#include <string>
#include <vector>

#include <gtest/gtest.h>

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

}  // namespace
}  // namespace inceres::internal
