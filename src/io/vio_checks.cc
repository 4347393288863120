#include "io/vio_checks.h"

// What a camera and the noise of a visual-inertial sequence must fulfill, said once for the reader,
// for VioSequence::Validate and for the simulator. Each puts its own words in front of "field: what
// is wrong"; comparisons are written so that a NaN fails.

namespace inceres::internal {

// Sizes first, then that all is finite, then the focal lengths: an image of no size needs no
// further look. Distortion may be anything finite.
std::string FaultOf(const VioCamera& camera) {
  if (camera.width < 1 || camera.height < 1) {
    return std::string(camera.width < 1 ? "width" : "height") + ": not positive";
  }
  if (!AllFinite(camera.intrinsics) || !AllFinite(camera.distortion) ||
      !AllFinite(camera.imu_from_camera)) {
    return "intrinsics, distortion or imu_from_camera: not finite";
  }
  if (!(camera.intrinsics[0] > 0.0 && camera.intrinsics[1] > 0.0)) {
    return std::string(camera.intrinsics[0] > 0.0 ? "f_y" : "f_x") + ": not positive";
  }
  return IsUnitQuaternion(camera.imu_from_camera.data() + 3) ? "" : "q_bc: not a unit quaternion";
}

// An information is the inverse of a variance: no deviation may be 0.
std::string FaultOf(double pixel_noise, const ImuNoise& noise) {
  const struct {
    const char* name;
    double value;
  } fields[] = {{"pixel", pixel_noise},
                {"gyr", noise.gyr},
                {"acc", noise.acc},
                {"gyr_bias_walk", noise.gyr_bias_walk},
                {"acc_bias_walk", noise.acc_bias_walk}};
  for (const auto& field : fields) {
    if (!(field.value > 0.0 && std::isfinite(field.value))) {
      return std::string(field.name) + ": not positive";
    }
  }
  return "";
}

}  // namespace inceres::internal
