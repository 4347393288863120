#include "tools/generate/scene_flags.h"

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <string>
#include <utility>
#include <vector>

#include <gflags/gflags.h>

#include "tools/command_line/command_line.h"
#include "tools/sim/city_scene.h"
#include "tools/sim/collection_scene.h"
#include "tools/sim/street_scene.h"

DEFINE_int32(num_cameras, 100, "cameras along the path, 2 to 1000000");
DEFINE_double(points_per_camera, 100.0,
              "number of points = this times num_cameras, unless num_points is given");
DEFINE_double(track_length, 4.0,
              "mean number of cameras that see a point, at least 2; number of observations = this "
              "times the number of points, unless num_observations is given. In a city: the mean "
              "of the lengths that are drawn, by default in proportion to street_width, 5 at 16 m");
DEFINE_int32(num_points, 0, "exact number of points (0: see points_per_camera)");
DEFINE_int32(num_observations, 0, "exact number of observations (0: see track_length)");
DEFINE_double(laps, 0.0,
              "rounds of a closed circuit; 0: an open street, 1: the end meets the start, 2.5: "
              "every place is passed two or three times. Streets only");
DEFINE_double(loop_fraction, 0.3,
              "share of the points that are recognized when the camera comes by again, 0 to 1. "
              "Streets and cities only");
DEFINE_double(camera_spacing, 0.0,
              "meters between consecutive cameras; 0: what the track length needs, 2 in a city. "
              "Streets and cities only");
DEFINE_double(street_width, 16.0,
              "meters from facade to facade in a city, 8 to 200: the wider, the more cameras have "
              "points in common");
DEFINE_double(drift, 1.0,
              "how far start values of a city drift: from crossing to crossing by this times "
              "0.005 rad, 1 % of scale and 0.1 m, accumulating; 0 to 20");
DEFINE_bool(true_start, false,
            "start values are the truth; observations stay as they are. For the cost that a solver "
            "can be expected to reach");
DEFINE_double(pixel_noise, 0.5, "standard deviation of the observations, pixels");
DEFINE_double(rotation_noise, 0.01, "of the start values of the camera orientations, radians");
DEFINE_double(position_noise, 0.1, "of the start values of the camera centers, meters");
DEFINE_double(focal_noise, 0.01, "of the start values of the focal lengths, relative");
DEFINE_double(distortion_noise, 0.002, "of the start values of k1 and k2");
DEFINE_double(point_noise, 0.1, "of the start values of the points, meters");
DEFINE_double(outlier_fraction, 0.0, "share of the observations that are wrong, 0 to 1");
DEFINE_double(outlier_pixels, 50.0, "how far outliers are displaced at most, in x and in y");
DEFINE_uint64(seed, 1, "the same seed and flags give the same file on every machine");

namespace inceres::tools {
namespace {

Status ToCount(const char* what, double value, int* count) {
  if (!(value >= 0.0 && value <= 2147483646.0)) {
    return Invalid(std::string(what) + " would be " + std::to_string(value));
  }
  *count = static_cast<int>(std::lround(value));
  return Status::Ok();
}

// Flags that a scene does not have.
Status Refuse(const char* scene, std::initializer_list<const char*> flags) {
  for (const char* flag : flags) {
    if (IsSet(flag)) {
      return Invalid(std::string("--") + flag + " is not for a " + scene);
    }
  }
  return Status::Ok();
}

// Number of points: as given, else per camera where that is given or the number is not known yet.
Status SetPoints(bool known, int num_cameras, int* num_points) {
  if (IsSet("num_points")) {
    *num_points = FLAGS_num_points;
  } else if (!known || IsSet("points_per_camera")) {
    return ToCount("the number of points", FLAGS_points_per_camera * num_cameras, num_points);
  }
  return Status::Ok();
}

Status SetObservations(bool known, int num_points, int* num_observations) {
  if (IsSet("num_observations")) {
    *num_observations = FLAGS_num_observations;
  } else if (!known || IsSet("track_length")) {
    return ToCount("the number of observations", FLAGS_track_length * num_points, num_observations);
  }
  return Status::Ok();
}

void SetNoise(BalNoise* noise) {
  noise->pixel_noise = FLAGS_pixel_noise;
  noise->rotation_noise = FLAGS_rotation_noise;
  noise->position_noise = FLAGS_position_noise;
  noise->focal_noise = FLAGS_focal_noise;
  noise->distortion_noise = FLAGS_distortion_noise;
  noise->point_noise = FLAGS_point_noise;
  noise->outlier_fraction = FLAGS_outlier_fraction;
  noise->outlier_pixels = FLAGS_outlier_pixels;
}

// --true_start, once the options are known to be valid.
template <typename Options>
Status StartAtTruth(Options* options) {
  Status status = options->Validate();
  if (FLAGS_true_start) {
    options->StartAtTruth();
  }
  return status;
}

}  // namespace

// Sizes: from the preset, then from what was given on the command line; derived ones follow.
Status ReadStreet(const std::string& name, StreetSceneOptions* options) {
  const bool preset = !name.empty();
  Status status = Refuse("street", {"street_width", "drift"});
  if (status.ok() && preset) {
    status = GetStreetScenePreset(name, options);
  }
  if (!status.ok()) {
    return status;
  }
  if (!preset || IsSet("num_cameras")) {
    options->num_cameras = FLAGS_num_cameras;
  }
  status = SetPoints(preset, options->num_cameras, &options->num_points);
  if (status.ok()) {
    status = SetObservations(preset, options->num_points, &options->num_observations);
  }
  if (!preset || IsSet("laps")) {
    options->laps = FLAGS_laps;
  }
  if (!preset || IsSet("loop_fraction")) {
    options->loop_fraction = FLAGS_loop_fraction;
  }
  options->camera_spacing = FLAGS_camera_spacing;
  options->seed = FLAGS_seed;
  SetNoise(options);
  return status.ok() ? StartAtTruth(options) : status;
}

Status ReadCity(const std::string& name, CityOptions* options) {
  Status status = Refuse("city", {"laps", "num_cameras"});
  if (status.ok()) {
    status = GetCityPreset(name, options);
  }
  if (status.ok()) {
    status = SetPoints(true, options->num_cameras, &options->num_points);
  }
  if (IsSet("num_observations")) {
    options->num_observations = FLAGS_num_observations;
  }
  if (IsSet("track_length")) {
    options->track_length = FLAGS_track_length;
  }
  if (FLAGS_camera_spacing != 0.0) {
    options->camera_spacing = FLAGS_camera_spacing;
  }
  options->street_width = FLAGS_street_width;
  options->loop_fraction = FLAGS_loop_fraction;
  options->drift = FLAGS_drift;
  options->seed = FLAGS_seed;
  SetNoise(options);
  status = status.ok() ? StartAtTruth(options) : status;
  if (FLAGS_true_start) {
    options->drift = 0.0;
  }
  return status;
}

Status ReadCollection(const std::string& name, CollectionOptions* options) {
  Status status = Refuse("collection", {"laps", "num_cameras", "loop_fraction", "camera_spacing",
                                        "street_width", "drift"});
  if (status.ok()) {
    status = GetCollectionPreset(name, options);
  }
  if (status.ok()) {
    status = SetPoints(true, options->num_cameras, &options->num_points);
  }
  if (status.ok()) {
    status = SetObservations(true, options->num_points, &options->num_observations);
  }
  options->seed = FLAGS_seed;
  SetNoise(options);
  return status.ok() ? StartAtTruth(options) : status;
}

Status CheckSceneFlags() {
  for (const auto& [exact, relative] : {std::pair("num_points", "points_per_camera"),
                                        std::pair("num_observations", "track_length")}) {
    if (IsSet(exact) && IsSet(relative)) {
      return Invalid(std::string("--") + exact + " and --" + relative +
                     " both say the same; give one");
    }
  }
  return Status::Ok();
}

std::string FirstSceneFlagSet() {
  std::vector<gflags::CommandLineFlagInfo> flags;
  gflags::GetAllFlags(&flags);
  const auto set = std::find_if(flags.begin(), flags.end(), [](const auto& flag) {
    return flag.filename == __FILE__ && !flag.is_default;
  });
  return set != flags.end() ? set->name : "";
}

std::uint64_t SceneSeed() {
  return FLAGS_seed;
}

}  // namespace inceres::tools
