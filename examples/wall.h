#pragma once

#include <array>
#include <cmath>

#include "examples/noise.h"
#include "inceres/factors/point_reprojection.h"

/// A long wall, and a camera that passes it at four meters, looking straight at it, with a picture
/// every meter: camera i stands at x = i, y = z = 0, its z axis ahead. Whatever is asked for has
/// the same answer each time.
namespace wall {

constexpr double kFocal = 500.0;  // pixels
constexpr double kPixelSigma = 0.5;
constexpr int kPointsPerMeter = 6;

/// Camera i sees the points [FirstSeen(i), EndSeen(i)): those up to two meters to its sides.
inline int FirstSeen(int i) {
  return i < 2 ? 0 : (i - 2) * kPointsPerMeter;
}
inline int EndSeen(int i) {
  return (i + 3) * kPointsPerMeter;
}

/// Where point k is: one after the other along the wall, at any height and depth.
inline std::array<double, 3> Point(int k) {
  Noise noise(static_cast<std::uint32_t>(k));
  return {static_cast<double>(k) / kPointsPerMeter, 2.0 * noise.Uniform() - 1.0,
          4.0 + noise.Uniform()};
}

/// The point, ten centimeters beside where it is: a start value.
inline std::array<double, 3> PointStart(int k) {
  Noise noise(1000000 + static_cast<std::uint32_t>(k));
  const std::array<double, 3> X = Point(k);
  return {X[0] + noise.Normal(0.1), X[1] + noise.Normal(0.1), X[2] + noise.Normal(0.1)};
}

/// The pose of camera i [p, q], so many meters beside the truth.
inline std::array<double, 7> Pose(int i, double sigma) {
  Noise noise(2000000 + static_cast<std::uint32_t>(i));
  return {i + noise.Normal(sigma), noise.Normal(sigma), noise.Normal(sigma), 0.0, 0.0, 0.0, 1.0};
}

inline inceres::PinholeCamera Camera() {
  inceres::PinholeCamera camera;
  camera.f_x = camera.f_y = kFocal;
  return camera;
}

/// Where camera i sees point k, half a pixel beside the truth.
inline inceres::PixelObservation Sight(int i, int k) {
  Noise noise(3000000 + 1000 * static_cast<std::uint32_t>(k) + static_cast<std::uint32_t>(i));
  const std::array<double, 3> X = Point(k);
  return {{kFocal * (X[0] - i) / X[2] + noise.Normal(kPixelSigma),
           kFocal * X[1] / X[2] + noise.Normal(kPixelSigma)},
          {1.0 / kPixelSigma, 0.0, 1.0 / kPixelSigma}};
}

}  // namespace wall
