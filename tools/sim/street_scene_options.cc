#include <cmath>
#include <limits>
#include <string>

#include "tools/sim/bal_sizes.h"
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
  };
  if (Status status = internal::CheckRanges("StreetSceneOptions", ranges); !status.ok()) {
    return status;
  }
  if (Status status = BalNoise::Validate("StreetSceneOptions"); !status.ok()) {
    return status;
  }
  const double circumference = laps > 0.0 ? camera_spacing * num_cameras / laps : 0.0;
  if (circumference > 0.0 && circumference < internal::kMinCircumference) {
    return Invalid("camera_spacing is " + internal::ShortNumber(camera_spacing) +
                   ": a circuit of " + internal::ShortNumber(circumference) + " m, at least " +
                   internal::ShortNumber(internal::kMinCircumference) + " m are needed");
  }
  return internal::CheckBalSizes("StreetSceneOptions", num_cameras, num_points, num_observations,
                                 track_length);
}

Status GetStreetScenePreset(const std::string& name, StreetSceneOptions* options) {
  const Preset* preset = nullptr;
  if (Status status = internal::FindPreset(kPresets, name, &preset, ", city-N, collection-N");
      !status.ok()) {
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
