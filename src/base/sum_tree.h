#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace inceres::internal {

/// The sum of numbers of which few change at a time. Pairs are summed, then pairs of these, so that
/// its bits depend on the numbers and their places alone, whatever they were before and in which
/// order they came. Numbers that are not there yet are zero.
///
/// Cost: a change takes a sum for each power of two below the count, neighbors share theirs.
/// Source: Blelloch, "Prefix sums and their applications", 1990, the upsweep.
class SumTree {
 public:
  /// Room for indices < size; never less than there was.
  void Grow(std::size_t size) {
    std::size_t width = width_;
    while (width < size) {
      width *= 2;
    }
    if (width == width_) {
      return;
    }
    std::vector<double> nodes(2 * width, 0.0);
    std::copy(nodes_.begin() + static_cast<std::ptrdiff_t>(width_), nodes_.end(),
              nodes.begin() + static_cast<std::ptrdiff_t>(width));
    nodes_.swap(nodes);
    width_ = width;
    for (std::size_t node = width_ - 1; node > 0; --node) {
      nodes_[node] = nodes_[2 * node] + nodes_[2 * node + 1];
    }
  }

  double operator[](std::int32_t index) const {
    return nodes_[width_ + static_cast<std::size_t>(index)];
  }
  /// To be followed by Sum(indices), which takes it into account.
  void Set(std::int32_t index, double value) {
    nodes_[width_ + static_cast<std::size_t>(index)] = value;
  }
  /// The sum, where these, ascending, are all that were set since it was asked last.
  double Sum(const std::vector<std::int32_t>& indices) {
    parents_.assign(indices.begin(), indices.end());
    for (std::size_t first = width_; first > 1 && !parents_.empty(); first /= 2) {
      // The nodes of a row begin at its number: a parent's place in its row is half the child's.
      std::size_t count = 0;
      for (const std::int32_t place : parents_) {
        const std::int32_t parent = place / 2;
        if (count > 0 && parents_[count - 1] == parent) {
          continue;
        }
        parents_[count++] = parent;
        const std::size_t child = first + 2 * static_cast<std::size_t>(parent);
        nodes_[child / 2] = nodes_[child] + nodes_[child + 1];
      }
      parents_.resize(count);
    }
    return nodes_[1];
  }

  std::size_t Bytes() const {
    return nodes_.capacity() * sizeof(double) + parents_.capacity() * sizeof(std::int32_t);
  }

 private:
  std::size_t width_ = 1;                 // of the last row: a power of two
  std::vector<double> nodes_{0.0, 0.0};   // 1 is the root, the children of k are 2k and 2k + 1
  std::vector<std::int32_t> parents_;     // of what was set, row by row
};

}  // namespace inceres::internal
