#pragma once

#include <cmath>

namespace inceres::internal {

/// The larger one of `largest` and `value`, and NaN as soon as one of them is: a maximum that is
/// held against a tolerance must not pass over what is no number, as std::max(largest, NaN) does.
inline double LargerOf(double largest, double value) {
  return largest >= value || std::isnan(largest) ? largest : value;
}

}  // namespace inceres::internal
