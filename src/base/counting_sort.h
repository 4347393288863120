#pragma once

#include <cstddef>
#include <numeric>
#include <vector>

namespace inceres::internal {

/// Sorts items by the group they belong to, 0 … num_groups − 1, without storing them twice:
/// for_each(add) is called two times, to count and to place, and calls add(group, item) of each.
/// Those of group g are then items[begin[g]], … up to items[begin[g + 1]], in the order in which
/// they came. Cost: two walks, and one index a group besides what is returned.
template <typename Index, typename Item, typename ForEach>
void CountingSort(std::size_t num_groups, const ForEach& for_each, std::vector<Index>* begin,
                  std::vector<Item>* items) {
  begin->assign(num_groups + 1, 0);
  for_each([begin](auto group, const Item& /*item*/) {
    ++(*begin)[static_cast<std::size_t>(group) + 1];
  });
  std::partial_sum(begin->begin(), begin->end(), begin->begin());
  items->resize(static_cast<std::size_t>(begin->back()));
  std::vector<Index> next(begin->begin(), begin->end() - 1);
  for_each([&next, items](auto group, const Item& item) {
    (*items)[static_cast<std::size_t>(next[static_cast<std::size_t>(group)]++)] = item;
  });
}

}  // namespace inceres::internal
