#pragma once

#include <array>
#include <cstddef>
#include <utility>

namespace inceres::internal {

/// Iterations that a descent's pace is taken from.
inline constexpr int kPaceIterations = 10;

/// Whether a descent is so fast that at its pace all of the cost that can be gained would be gone
/// within the iterations that are left: then it keeps them. `gained`: in the last kPaceIterations.
inline bool IsOnItsWay(double gained, double cost, int iterations_left) {
  return gained * iterations_left >= kPaceIterations * cost;
}

/// What the last kPaceIterations of a descent have gained.
class DescentPace {
 public:
  /// After each iteration, from number 0 on: the cost that it has led to.
  void Note(int iteration, double cost) {
    double& long_ago = costs_[static_cast<std::size_t>(iteration % kPaceIterations)];
    gained_ = std::exchange(long_ago, cost) - cost;
  }
  double gained() const { return gained_; }

 private:
  std::array<double, kPaceIterations> costs_{};
  double gained_ = 0.0;
};

}  // namespace inceres::internal
