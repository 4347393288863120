#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "simd/kernels.h"

namespace inceres::internal {

/// Products by the blocks that they are added to, of which there are many, and few at a time.
class ProductLists {
 public:
  struct List {
    int block;
    int first_term;
    int count;
  };

  /// With a count for each block; 0: without, for where there are far more blocks than products.
  /// Sort then takes n log n of them.
  explicit ProductLists(int num_blocks) : next_(static_cast<std::size_t>(num_blocks), 0) {}

  void Add(int block, ProductTerm term) {
    if (!next_.empty() && next_[static_cast<std::size_t>(block)]++ == 0) {
      lists_.push_back({block, 0, 0});
    }
    if (num_added_ == added_.size()) {
      added_.resize(2 * num_added_ + 64);
    }
    added_[num_added_++] = {block, term};
  }

  /// What was added since Clear, in that order within each list. Cost: linear in it.
  const std::vector<List>& Sort() {
    if (next_.empty()) {
      return SortFew();
    }
    int end = 0;
    for (List& list : lists_) {
      int& next = next_[static_cast<std::size_t>(list.block)];
      list.first_term = end;
      list.count = next;
      end += next;
      next = list.first_term;
    }
    terms_.resize(added_.size());
    for (std::size_t n = 0; n < num_added_; ++n) {
      int& next = next_[static_cast<std::size_t>(added_[n].block)];
      terms_[static_cast<std::size_t>(next++)] = added_[n].term;
    }
    return lists_;
  }
  const ProductTerm* terms() const { return terms_.data(); }

  void Clear() {
    if (!next_.empty()) {
      for (const List& list : lists_) {
        next_[static_cast<std::size_t>(list.block)] = 0;
      }
    }
    lists_.clear();
    num_added_ = 0;
  }

 private:
  struct Added {
    int block;
    ProductTerm term;
  };
  // Without counts.
  const std::vector<List>& SortFew() {
    std::stable_sort(added_.begin(), added_.begin() + static_cast<std::ptrdiff_t>(num_added_),
                     [](const Added& a, const Added& b) { return a.block < b.block; });
    terms_.resize(added_.size());
    for (std::size_t n = 0; n < num_added_; ++n) {
      if (n == 0 || added_[n].block != added_[n - 1].block) {
        lists_.push_back({added_[n].block, static_cast<int>(n), 0});
      }
      ++lists_.back().count;
      terms_[n] = added_[n].term;
    }
    return lists_;
  }

  std::vector<int> next_;  // per block: how many were added, or where the next one goes
  std::vector<List> lists_;
  std::vector<Added> added_;  // and room for more
  std::size_t num_added_ = 0;
  std::vector<ProductTerm> terms_;
};

}  // namespace inceres::internal
