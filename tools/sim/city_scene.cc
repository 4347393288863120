#include "tools/sim/city_scene.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "tools/sim/bal_sizes.h"
#include "tools/sim/city_drift.h"
#include "tools/sim/city_view.h"
#include "tools/sim/option_range.h"
#include "tools/sim/scene_noise.h"
#include "tools/sim/track_builder.h"

namespace inceres {
namespace {

constexpr double kDrivenPerStreet = 1.3;
constexpr int kPointsPerCamera = 20;
constexpr std::uint64_t kDriftStream = 7;  // 0 to 6 are the route's, the tracks' and the noise's

// As many streets each way, n, as make 2 n (n − 1) stretches of the length that is driven.
int NumStreets(const CityOptions& options) {
  const double stretches = options.num_cameras * options.camera_spacing /
                           (kDrivenPerStreet * (options.street_width + options.block_length));
  return std::max(
      2, static_cast<int>(std::floor(0.5 * (1.0 + std::sqrt(1.0 + 2.0 * stretches)) + 0.5)));
}

}  // namespace

double CityOptions::MeanTrackLength() const {
  if (num_observations != 0) {
    return static_cast<double>(num_observations) / num_points;
  }
  return track_length != 0.0 ? track_length : std::max(3.0, 5.0 * street_width / 16.0);
}

Status CityOptions::Validate() const {
  const internal::OptionRange ranges[] = {
      {"num_cameras", static_cast<double>(num_cameras), 20, 1e6},
      {"num_points", static_cast<double>(num_points), 1, std::numeric_limits<int>::max()},
      {"track_length", track_length == 0.0 ? 2.0 : track_length, 2, 1000},
      {"camera_spacing", camera_spacing, 0.1, 20},
      {"street_width", street_width, 8, 200},
      {"block_length", block_length, 20, 1000},
      {"loop_fraction", loop_fraction, 0, 1},
      {"drift", drift, 0, 20},
  };
  if (Status status = internal::CheckRanges("CityOptions", ranges); !status.ok()) {
    return status;
  }
  if (Status status = BalNoise::Validate("CityOptions"); !status.ok()) {
    return status;
  }
  return internal::CheckBalSizes("CityOptions", num_cameras, num_points, num_observations,
                                 MeanTrackLength());
}

Status GenerateCity(const CityOptions& options, const SceneProgress& progress,
                    SimulatedBal* scene) {
  if (Status status = options.Validate(); !status.ok()) {
    return status;
  }
  const internal::CityGrid grid(NumStreets(options), options.street_width, options.block_length);
  internal::TrackCounts counts;
  counts.num_points = options.num_points;
  counts.num_observations = options.num_observations;
  counts.mean_track_length = options.MeanTrackLength();
  counts.scene = "city";
  counts.remedy =
      "ask for fewer observations per point, more points per camera, wider streets or cameras that "
      "are closer together";
  SimulatedBal result;
  Status status = internal::BuildTracks(counts, internal::CityView(options, grid), options.seed,
                                        progress, &result.problem);
  if (!status.ok()) {
    return status;
  }
  result.true_cameras = result.problem.cameras;
  result.true_points = result.problem.points;
  if (options.drift > 0.0) {
    internal::Random random(options.seed, kDriftStream);
    internal::CityDrift(grid, options.drift, &random).Apply(&result.problem);
  }
  internal::AddNoise(options, options.seed, &result.problem, &result.outliers);
  *scene = std::move(result);
  return Status::Ok();
}

Status GetCityPreset(const std::string& name, CityOptions* options) {
  CityOptions preset;
  Status status = internal::ParseSizedPreset(name, "city-", &preset.num_cameras);
  if (status.ok()) {
    preset.num_points = kPointsPerCamera * std::min(preset.num_cameras, 1000000);
    status = preset.Validate();
  }
  if (status.ok()) {
    *options = preset;
  }
  return status;
}

}  // namespace inceres
