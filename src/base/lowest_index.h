#pragma once

#include <atomic>

namespace inceres::internal {

/// The lowest of the indices that tasks note, in whatever order they do: the first failure of a
/// pass, say. What a task sees while others run may be out of date, and then too high; after
/// Executor::For it is exact.
class LowestIndex {
 public:
  explicit LowestIndex(int none) : lowest_(none) {}

  int get() const { return lowest_.load(std::memory_order_relaxed); }

  void Note(int index) {
    int lowest = get();
    while (index < lowest &&
           !lowest_.compare_exchange_weak(lowest, index, std::memory_order_relaxed)) {
    }
  }

 private:
  std::atomic<int> lowest_;
};

}  // namespace inceres::internal
