#pragma once

#include <algorithm>
#include <iterator>
#include <vector>

#include "base/sort_unique.h"
#include "linear/block_rows.h"

namespace inceres::internal {

/// Groups of any numbers as 0, 1, 2, … in the same order, which is what CAMD takes for classes: it
/// has no use for one without members.
inline std::vector<int> RanksOf(const std::vector<int>& groups) {
  std::vector<int> levels = groups;
  SortUnique(&levels);
  std::vector<int> ranks;
  ranks.reserve(groups.size());
  std::transform(groups.begin(), groups.end(), std::back_inserter(ranks), [&levels](int group) {
    return static_cast<int>(std::lower_bound(levels.begin(), levels.end(), group) - levels.begin());
  });
  return ranks;
}

/// Rows of lower groups before those of higher ones, otherwise in the order they have. Without
/// groups nothing is done.
inline void SortByGroup(const SymmetricBlockRows& S, std::vector<int>* rows) {
  if (S.has_groups()) {
    std::stable_sort(rows->begin(), rows->end(),
                     [&S](int a, int b) { return S.group_of(a) < S.group_of(b); });
  }
}
inline void SortByGroup(const BlockPattern& pattern, std::vector<int>* rows) {
  if (!pattern.groups.empty()) {
    std::stable_sort(rows->begin(), rows->end(),
                     [&pattern](int a, int b) { return pattern.groups[a] < pattern.groups[b]; });
  }
}

}  // namespace inceres::internal
