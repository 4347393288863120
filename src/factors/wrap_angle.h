#pragma once

#include <cmath>

namespace inceres::internal {

/// The angle less the nearest whole number of turns: in [−π, π], with the bits of std::remainder,
/// which takes as long as a sine and is mostly not needed.
inline double WrapAngle(double angle) {
  return std::fabs(angle) <= M_PI ? angle : std::remainder(angle, 2.0 * M_PI);
}

}  // namespace inceres::internal
