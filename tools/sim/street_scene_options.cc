#include <cmath>
#include <limits>
#include <string>

#include "tools/sim/option_range.h"
#include "tools/sim/preset_names.h"
#include "tools/sim/street_limits.h"
#include "tools/sim/street_scene.h"

namespace inceres {
namespace {

struct Preset {
  const char* name;
  int num_cameras, num_points, num_observations;
  double laps, loop_fraction, loop_stretch;
};

// The sizes of problems that the literature reports on; the scenes are ours. Then paths on which
// the growth of time and memory with size can be seen: each place is passed twice, and recognized
// along a tenth of the circuit.
constexpr Preset kPresets[] = {
    {"ladybug-like", 49, 7776, 31843, 0.0, 0.3, 1.0},
    {"venice11", 11, 8366, 20271, 0.0, 0.3, 1.0},
    {"cathedral", 92, 57957, 422163, 2.0, 0.7, 1.0},
    {"path-400", 400, 16000, 80000, 2.0, 0.3, 0.1},
    {"path-1800", 1800, 72000, 360000, 2.0, 0.3, 0.1},
    {"path-1000", 1000, 40000, 200000, 2.0, 0.3, 0.1},
    {"path-10000", 10000, 400000, 2000000, 2.0, 0.3, 0.1},
};

Status Invalid(const std::string& what) {
  return Status::Error(StatusCode::kInvalidArgument, "StreetSceneOptions: " + what);
}

Status CheckSizes(const StreetSceneOptions& options) {
  const std::int64_t cameras = options.num_cameras, points = options.num_points;
  const bool exact = options.num_observations != 0;
  const std::int64_t observations =
      exact ? options.num_observations
            : static_cast<std::int64_t>(options.track_length * static_cast<double>(points));
  if (exact && (observations < 2 * points || observations > cameras * points)) {
    return Invalid("num_observations is " + std::to_string(observations) +
                   ", not between two per point (" + std::to_string(2 * points) +
                   ") and every point in every camera (" + std::to_string(cameras * points) + ")");
  }
  if (2 * observations + 7 <
      9 * cameras + 3 * points) {  // seven are the free choice of the coordinate frame
    return Invalid((exact ? "num_observations is "
                          : "track_length is " + internal::ShortNumber(options.track_length) +
                                ", observations about ") +
                   std::to_string(observations) +
                   ": two equations each are fewer than the unknowns of " +
                   std::to_string(cameras) + " cameras and " + std::to_string(points) + " points");
  }
  return Status::Ok();
}

}  // namespace

double StreetSceneOptions::MeanTrackLength() const {
  return num_observations != 0 ? static_cast<double>(num_observations) / num_points : track_length;
}

Status StreetSceneOptions::Validate() const {
  const internal::OptionRange ranges[] = {
      {"num_cameras", static_cast<double>(num_cameras), 2, 1e6},
      {"num_points", static_cast<double>(num_points), 1, std::numeric_limits<int>::max()},
      {"track_length", track_length, 2, 1000},
      {"laps", laps, 0, 1000},
      {"loop_fraction", loop_fraction, 0, 1},
      {"loop_stretch", loop_stretch, 0, 1},
      {"camera_spacing", camera_spacing, 0, 10},
      {"pixel_noise", pixel_noise, 0, 1e6},
      {"rotation_noise", rotation_noise, 0, 1},
      {"position_noise", position_noise, 0, 1e6},
      {"focal_noise", focal_noise, 0, 1},
      {"distortion_noise", distortion_noise, 0, 1},
      {"point_noise", point_noise, 0, 1e6},
      {"outlier_fraction", outlier_fraction, 0, 1},
      {"outlier_pixels", outlier_pixels, 0, 1e6},
  };
  if (Status status = internal::CheckRanges("StreetSceneOptions", ranges); !status.ok()) {
    return status;
  }
  const double circumference = laps > 0.0 ? camera_spacing * num_cameras / laps : 0.0;
  if (circumference > 0.0 && circumference < internal::kMinCircumference) {
    return Invalid("camera_spacing is " + internal::ShortNumber(camera_spacing) +
                   ": a circuit of " + internal::ShortNumber(circumference) + " m, at least " +
                   internal::ShortNumber(internal::kMinCircumference) + " m are needed");
  }
  return CheckSizes(*this);
}

std::vector<std::string> StreetScenePresets() {
  return internal::PresetNames(kPresets);
}

Status GetStreetScenePreset(const std::string& name, StreetSceneOptions* options) {
  const Preset* preset = nullptr;
  if (Status status = internal::FindPreset(kPresets, name, &preset); !status.ok()) {
    return status;
  }
  *options = StreetSceneOptions();
  options->num_cameras = preset->num_cameras;
  options->num_points = preset->num_points;
  options->num_observations = preset->num_observations;
  options->laps = preset->laps;
  options->loop_fraction = preset->loop_fraction;
  options->loop_stretch = preset->loop_stretch;
  return Status::Ok();
}

}  // namespace inceres
