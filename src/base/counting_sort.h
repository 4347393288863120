#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
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

/// The same of items 0, 1, … num_items − 1 by the threads of an Executor: group_of(item), −1 of an
/// item that is left out, is asked for twice. Cost: two walks, and one index a group and thread.
template <typename Executors, typename GroupOf, typename Items>
void CountingSort(const Executors& executor, int num_groups, int num_items, const GroupOf& group_of,
                  std::vector<int>* begin, Items* items) {
  constexpr int kItemsAThread = 1 << 14;  // at least
  const int num_parts = std::clamp(num_items / kItemsAThread, 1, executor.num_threads());
  const auto begin_of = [&](int part) {
    return static_cast<int>(static_cast<std::int64_t>(part) * num_items / num_parts);
  };
  std::vector<std::vector<int>> next(
      static_cast<std::size_t>(num_parts));  // of each part and group
  executor.For(num_parts, 1, [&](int first, int last) {
    for (int part = first; part < last; ++part) {
      std::vector<int>& counts = next[static_cast<std::size_t>(part)];
      counts.assign(static_cast<std::size_t>(num_groups), 0);
      for (int i = begin_of(part); i < begin_of(part + 1); ++i) {
        const int group = group_of(i);
        if (group >= 0) {
          ++counts[static_cast<std::size_t>(group)];
        }
      }
    }
  });
  begin->resize(static_cast<std::size_t>(num_groups) + 1);
  int end = 0;
  for (std::size_t group = 0; group < static_cast<std::size_t>(num_groups); ++group) {
    (*begin)[group] = end;
    for (std::vector<int>& counts : next) {
      const int count = counts[group];
      counts[group] = end;
      end += count;
    }
  }
  begin->back() = end;
  items->resize(static_cast<std::size_t>(end));
  if (end == 0) {
    return;
  }
  executor.For(num_parts, 1, [&](int first, int last) {
    for (int part = first; part < last; ++part) {
      int* const places = next[static_cast<std::size_t>(part)].data();
      for (int i = begin_of(part); i < begin_of(part + 1); ++i) {
        const int group = group_of(i);
        if (group >= 0) {
          (*items)[static_cast<std::size_t>(places[group]++)] = i;
        }
      }
    }
  });
}

}  // namespace inceres::internal
