#include "tools/sim/bal_noise.h"

#include "tools/sim/option_range.h"

namespace inceres {

Status BalNoise::Validate(const char* options) const {
  const internal::OptionRange ranges[] = {
      {"pixel_noise", pixel_noise, 0, 1e6},         {"rotation_noise", rotation_noise, 0, 1},
      {"position_noise", position_noise, 0, 1e6},   {"focal_noise", focal_noise, 0, 1},
      {"distortion_noise", distortion_noise, 0, 1}, {"point_noise", point_noise, 0, 1e6},
      {"outlier_fraction", outlier_fraction, 0, 1}, {"outlier_pixels", outlier_pixels, 0, 1e6},
  };
  return internal::CheckRanges(options, ranges);
}

}  // namespace inceres
