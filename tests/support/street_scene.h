#pragma once

#include <array>
#include <cstddef>

#include "support/random_values.h"

namespace inceres::test {

/// R(c) x with Cayley's parameters c.
template <typename T>
void Rotate(const T* c, const T* x, T* out) {
  const T square = c[0] * c[0] + c[1] * c[1] + c[2] * c[2];
  const T dot = c[0] * x[0] + c[1] * x[1] + c[2] * x[2];
  const T cross[3] = {c[1] * x[2] - c[2] * x[1], c[2] * x[0] - c[0] * x[2],
                      c[0] * x[1] - c[1] * x[0]};
  for (int k = 0; k < 3; ++k) {
    out[k] = ((1.0 - square) * x[k] + 2.0 * cross[k] + 2.0 * dot * c[k]) / (1.0 + square);
  }
}

/// Functors for Ceres's AutoDiff and for ours: a camera is rotation (Cayley's parameters),
/// translation and focal length, in blocks of their own or in one.
struct SplitView {
  template <typename T>
  bool operator()(const T* rotation, const T* translation, const T* focal, const T* point,
                  T* residuals) const {
    T x[3];
    Rotate(rotation, point, x);
    for (int k = 0; k < 3; ++k) {
      x[k] = x[k] + translation[k];
    }
    residuals[0] = focal[0] * x[0] / x[2] - u;
    residuals[1] = focal[0] * x[1] / x[2] - v;
    return true;
  }
  double u, v;
};

struct WholeView {
  template <typename T>
  bool operator()(const T* camera, const T* point, T* residuals) const {
    return SplitView{u, v}(camera, camera + 3, camera + 6, point, residuals);
  }
  double u, v;
};

/// A street along x: cameras at (i, 0, 0) that look along z, and points beside and before them,
/// seen with noise. What starts off is a camera's rotation and position, by an offset that adds up
/// from camera to camera. Numbers come in the order in which they are asked for.
class StreetScene {
 public:
  static constexpr double kFocal = 100.0;

  /// The next camera as it starts: each is farther off its place than the one before.
  std::array<double, 7> NextCamera(double drift) {
    for (double& offset : offset_) {
      offset += random_.Between(-drift, drift);
    }
    return {0.1 * offset_[0],
            0.1 * offset_[1],
            0.1 * offset_[2],
            offset_[3] - num_cameras_++,
            offset_[4],
            offset_[5],
            kFocal};
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
  int num_cameras_ = 0;
};

}  // namespace inceres::test
