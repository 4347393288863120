#pragma once

#include <algorithm>
#include <functional>
#include <vector>

namespace inceres::internal {

/// Ascending, each once. `less` tells apart whatever == does.
template <typename Value, typename Less = std::less<>>
void SortUnique(std::vector<Value>* values, const Less& less = Less()) {
  std::sort(values->begin(), values->end(), less);
  values->erase(std::unique(values->begin(), values->end()), values->end());
}

}  // namespace inceres::internal
