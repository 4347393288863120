#pragma once

#include "inceres/status.h"

namespace inceres {

/// What is wrong with the start values and the measurements of a simulated BAL problem. Noise knobs
/// are standard deviations; 0 switches a noise off, and leaves all else as it was.
struct BalNoise {
  double pixel_noise = 0.5;         ///< observations: each coordinate, pixels
  double rotation_noise = 0.01;     ///< start values: each component of a rotation vector, radians
  double position_noise = 0.1;      ///< start values: each coordinate of a camera center, meters
  double focal_noise = 0.01;        ///< start values: relative to the focal length
  double distortion_noise = 0.002;  ///< start values: k1 and k2
  double point_noise = 0.1;         ///< start values: each coordinate of a point

  /// share of the observations that are wrong, 0 .. 1; the number is rounded to the nearest
  double outlier_fraction = 0.0;
  /// outliers are displaced by up to this much in x and in y, uniformly
  double outlier_pixels = 50.0;

  /// Start values are the truth; measurements stay as they are.
  void StartAtTruth() {
    rotation_noise = position_noise = focal_noise = distortion_noise = point_noise = 0.0;
  }
  /// Ok, or kInvalidArgument "`options`: NAME is …" of the first knob out of its range.
  Status Validate(const char* options) const;
};

}  // namespace inceres
