#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "linearize/incremental_family.h"

namespace inceres::internal {

/// The cost of a living problem, kept by difference: what a factor's has been goes out, what it is
/// goes in.
class RunningCost {
 public:
  double value() const { return value_; }
  void Add(double change) {
    value_ += change;
    peak_ = std::max(peak_, value_);
    ++num_changes_;
  }
  /// Back to what it was before changes that have failed.
  void TakeBack(double value) { value_ = value; }

  /// Sums it anew after as many changes as there are factors, so that rounding does not pile up,
  /// and when it has fallen far, for what is left of it would be rounding. In the order of the
  /// factors' places.
  void Resum(const std::vector<IncrementalFamily>& families, int num_factors) {
    if (num_changes_ <= num_factors && peak_ <= kResumFall * value_) {
      return;
    }
    num_changes_ = 0;
    value_ = 0.0;
    for (const IncrementalFamily& family : families) {
      // By family and place: the same order whenever it is summed, so the same bits.
      for (std::int32_t i = 0; i < family.num_places(); ++i) {
        value_ += family.weighed().linearized(i) ? family.weighed().Cost(i) : 0.0;
      }
    }
    peak_ = value_;
  }

 private:
  // Fall of the cost below its peak at which it is summed anew: rounding of the peak would be a
  // share of what is left.
  static constexpr double kResumFall = 1e4;

  double value_ = 0.0;
  double peak_ = 0.0;             // the largest it has been since it was summed
  std::int64_t num_changes_ = 0;  // since then
};

}  // namespace inceres::internal
