#pragma once

#include <array>
#include <cstddef>

#include "support/random_values.h"

namespace inceres::test {

/// Pulls a position to where the street has it, with standard deviation ½ per axis: an AutoDiff
/// functor for either problem.
struct TranslationPrior {
  template <typename T>
  bool operator()(const T* translation, T* residuals) const {
    for (int k = 0; k < 3; ++k) {
      residuals[k] = 2.0 * (translation[k] - at[k]);
    }
    return true;
  }
  double at[3];
};

/// A street along x: cameras at (i, 0, 0) that look along z, and points beside and before them,
/// seen with noise. What starts off is a camera's rotation and position, by an offset that adds up
/// from camera to camera. Numbers come in the order in which they are asked for.
class StreetScene {
 public:
  static constexpr double kFocal = 100.0;

  /// The next camera's offset: three of its rotation, three of its translation, which is (−i, 0,
  /// 0) but for that.
  const std::array<double, 6>& NextOffset(double drift) {
    for (double& offset : offset_) {
      offset += random_.Between(-drift, drift);
    }
    return offset_;
  }
  /// A point that is seen from a few cameras, the first of which is this one.
  std::array<double, 3> Point(int first) {
    // One after another: a list's order of evaluation is that of its entries.
    return {first + random_.Between(0.0, 3.0), random_.Between(-3.0, 3.0),
            random_.Between(4.0, 9.0)};
  }
  /// Where a camera sees it, half a pixel off at most.
  std::array<double, 2> Pixel(const std::array<double, 3>& x, int camera) {
    return {kFocal * (x[0] - camera) / x[2] + random_.Between(-0.5, 0.5),
            kFocal * x[1] / x[2] + random_.Between(-0.5, 0.5)};
  }
  Random& random() { return random_; }

 private:
  Random random_{7};
  std::array<double, 6> offset_{};
};

}  // namespace inceres::test
