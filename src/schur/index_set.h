#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

namespace inceres::internal {

/// A set of small indices that is emptied in time proportional to what it holds, for marking a part of a large problem.
class IndexSet {
 public:
  /// Makes room for indices < size.
  void Grow(std::size_t size) { member_.resize(size, 0); }

  /// False if it was there already.
  bool Add(std::int32_t index) {
    if (member_[index] != 0) {
      return false;
    }
    member_[index] = 1;
    indices_.push_back(index);
    return true;
  }
  bool Has(std::int32_t index) const { return member_[index] != 0; }
  bool empty() const { return indices_.empty(); }
  /// In order of addition, or ascending after Sort.
  const std::vector<std::int32_t>& indices() const { return indices_; }
  void Sort() { std::sort(indices_.begin(), indices_.end()); }

  void Clear() {
    for (const std::int32_t index : indices_) {
      member_[index] = 0;
    }
    indices_.clear();
  }

 private:
  std::vector<char> member_;
  std::vector<std::int32_t> indices_;
};

}  // namespace inceres::internal
