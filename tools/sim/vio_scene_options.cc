#include <cstdint>
#include <string>

#include "io/vio_checks.h"
#include "tools/sim/option_range.h"
#include "tools/sim/preset_names.h"
#include "tools/sim/vio_scene.h"

namespace inceres {
namespace {

VioSceneOptions Cubic() {
  VioSceneOptions options;
  options.num_frames = 50;
  options.num_points = 163;
  options.num_observations = 789;
  options.frame_rate = 4.0;
  options.imu_per_frame = 50;
  // A start as far off as the one reported: the whitened cost is 2.8e3, 2.5e3, 2.8e3 for seeds 1 to
  // 3; there it was 2.514e3.
  options.initial_gyr_bias = 5e-4;
  options.initial_acc_bias = 5e-3;
  options.position_drift = 0.006;
  options.rotation_drift = 5e-4;
  options.point_noise = 0.01;
  return options;
}

VioSceneOptions FigureEight() {
  VioSceneOptions options;
  options.trajectory.shape = TrajectoryOptions::Shape::kFigureEight;
  options.num_frames = 600;
  options.num_points = 1500;
  options.max_track_length = 40;
  options.loop_fraction = 0.5;
  return options;
}

VioSceneOptions Ellipse() {
  VioSceneOptions options;
  options.trajectory.shape = TrajectoryOptions::Shape::kEllipse;
  options.trajectory.radius = 15.0;
  options.trajectory.height = 1.0;
  options.trajectory.stop_every = 6.0;
  options.trajectory.stop_duration = 4.0;
  options.num_frames = 600;
  options.num_points = 2000;
  options.max_depth = 30.0;
  return options;
}

struct Preset {
  const char* name;
  VioSceneOptions (*make)();
};

constexpr Preset kPresets[] = {
    {"cubic", Cubic}, {"figure_eight", FigureEight}, {"ellipse", Ellipse}};

Status Invalid(const std::string& what) {
  return Status::Error(StatusCode::kInvalidArgument, "VioSceneOptions: " + what);
}

}  // namespace

Status VioSceneOptions::Validate() const {
  const internal::OptionRange ranges[] = {
      {"num_frames", static_cast<double>(num_frames), 2, 1e6},
      {"frame_rate", frame_rate, 0.01, 1000},
      {"imu_per_frame", static_cast<double>(imu_per_frame), 1, 1e4},
      {"num_points", static_cast<double>(num_points), 1, 1e7},
      {"max_track_length", static_cast<double>(max_track_length), 2, 1e6},
      {"min_depth", min_depth, 0.01, 1e6},
      {"max_depth", max_depth, 0.01, 1e6},
      {"min_parallax", min_parallax, 0, 1},
      {"loop_fraction", loop_fraction, 0, 1},
      {"dropout", dropout, 0, 0.95},
      {"pixel_noise", pixel_noise, 0, 1e6},
      {"outlier_fraction", outlier_fraction, 0, 1},
      {"outlier_pixels", outlier_pixels, 0, 1e6},
      {"gyr_noise", gyr_noise, 0, 1e3},
      {"acc_noise", acc_noise, 0, 1e3},
      {"gyr_bias_walk", gyr_bias_walk, 0, 1e3},
      {"acc_bias_walk", acc_bias_walk, 0, 1e3},
      {"initial_gyr_bias", initial_gyr_bias, 0, 1e3},
      {"initial_acc_bias", initial_acc_bias, 0, 1e3},
      {"position_drift", position_drift, 0, 1e6},
      {"rotation_drift", rotation_drift, 0, 1},
      {"point_noise", point_noise, 0, 1e6},
  };
  if (Status status = internal::CheckRanges("VioSceneOptions", ranges); !status.ok()) {
    return status;
  }
  if (!(min_depth < max_depth)) {
    return Invalid("min_depth is " + internal::ShortNumber(min_depth) + ", not below max_depth, " +
                   internal::ShortNumber(max_depth));
  }
  if (std::string fault = internal::FaultOf(camera); !fault.empty()) {
    return Invalid("camera." + fault);
  }
  if (num_observations != 0 && num_observations < 2 * static_cast<std::int64_t>(num_points)) {
    return Invalid("num_observations is " + std::to_string(num_observations) +
                   ", fewer than two per point (" +
                   std::to_string(2 * static_cast<std::int64_t>(num_points)) + ")");
  }
  return trajectory.Validate();
}

std::vector<std::string> VioScenePresets() {
  return internal::PresetNames(kPresets);
}

Status GetVioScenePreset(const std::string& name, VioSceneOptions* options) {
  const Preset* preset = nullptr;
  if (Status status = internal::FindPreset(kPresets, name, &preset); !status.ok()) {
    return status;
  }
  *options = preset->make();
  return Status::Ok();
}

}  // namespace inceres
