#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "tools/sim/portable_math.h"

namespace inceres::internal {

/// Numbers from 2 on, more than k with probability about (2 / k)^α.
class HeavyTail {
 public:
  /// The α with which so many draws of each limit, cut at the limit, have this mean; limits from 2
  /// on. A mean that no α reaches gets the nearest.
  HeavyTail(double mean, const std::vector<int>& limits, const std::vector<std::int64_t>& draws);

  /// What a draw with this limit is in the mean, and the sum of all draws. The limit is at most the
  /// largest of those given.
  double Expected(int limit) const { return expected_[static_cast<std::size_t>(limit)]; }
  double ExpectedSum() const { return sum_; }
  int Draw(int limit, Random* random) const;

 private:
  // Fills expected_ and sum_.
  void Expect(const std::vector<int>& limits, const std::vector<std::int64_t>& draws);

  double exponent_ = 1.0;  // α
  std::vector<double> expected_;
  double sum_ = 0.0;
};

}  // namespace inceres::internal
