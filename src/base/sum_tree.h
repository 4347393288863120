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
    places_.reserve(width);
    width_ = width;
    for (std::size_t node = width_ - 1; node > 0; --node) {
      Add(node);
    }
  }

  double operator[](std::int32_t index) const {
    return nodes_[width_ + static_cast<std::size_t>(index)];
  }
  double sum() const { return nodes_[1]; }

  void Set(std::int32_t index, double value) {
    std::size_t node = width_ + static_cast<std::size_t>(index);
    nodes_[node] = value;
    while (node > 1) {
      Add(node /= 2);
    }
  }
  /// Each of these, which ascend, becomes value(index). Sums that several of them are part of are
  /// made once.
  template <typename Value>
  void Set(const std::vector<std::int32_t>& indices, const Value& value) {
    places_.assign(indices.begin(), indices.end());
    for (const std::int32_t index : indices) {
      nodes_[width_ + static_cast<std::size_t>(index)] = value(index);
    }
    for (std::size_t first = width_ / 2; first > 0; first /= 2) {
      // The nodes of a row begin at `first`, and a parent's place is half of its children's.
      std::size_t count = 0;
      for (const std::int32_t child : places_) {
        const std::int32_t place = child / 2;
        if (count == 0 || places_[count - 1] != place) {
          places_[count++] = place;
          Add(first + static_cast<std::size_t>(place));
        }
      }
      places_.resize(count);
    }
  }

  std::size_t Bytes() const {
    return nodes_.capacity() * sizeof(double) + places_.capacity() * sizeof(std::int32_t);
  }

 private:
  void Add(std::size_t node) { nodes_[node] = nodes_[2 * node] + nodes_[2 * node + 1]; }

  std::size_t width_ = 1;                // of the last row: a power of two
  std::vector<double> nodes_{0.0, 0.0};  // 1 is the root, the children of k are 2k and 2k + 1
  std::vector<std::int32_t> places_;     // in their row, of those whose sums are made
};

}  // namespace inceres::internal
