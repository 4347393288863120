#pragma once

namespace inceres::internal {

/// Iterations that a descent's pace is taken from.
inline constexpr int kPaceIterations = 10;

/// Whether a descent is so fast that at its pace all of the cost that can be gained would be gone
/// within the iterations that are left: then it keeps them. `gained`: in the last kPaceIterations.
inline bool IsOnItsWay(double gained, double cost, int iterations_left) {
  return gained * iterations_left >= kPaceIterations * cost;
}

}  // namespace inceres::internal
