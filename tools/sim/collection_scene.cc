#include "tools/sim/collection_scene.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "tools/sim/bal_sizes.h"
#include "tools/sim/collection_tracks.h"
#include "tools/sim/option_range.h"
#include "tools/sim/scene_noise.h"

namespace inceres {
namespace {

// The largest problem of Agarwal et al., "Bundle Adjustment in the Large", ECCV 2010.
constexpr int kFinalCameras = 13682, kFinalPoints = 4456117, kFinalObservations = 28987644;
// Of the observations a point, from 16 cameras to as many as that.
constexpr double kGrowth = static_cast<double>(kFinalObservations) / kFinalPoints - 2.9;

}  // namespace

Status CollectionOptions::Validate() const {
  const internal::OptionRange ranges[] = {
      {"num_cameras", static_cast<double>(num_cameras), 20, 1e6},
      {"num_points", static_cast<double>(num_points), 1, std::numeric_limits<int>::max()},
  };
  if (Status status = internal::CheckRanges("CollectionOptions", ranges); !status.ok()) {
    return status;
  }
  if (Status status = BalNoise::Validate("CollectionOptions"); !status.ok()) {
    return status;
  }
  if (num_observations <= 0) {
    return Status::Error(StatusCode::kInvalidArgument, "CollectionOptions: num_observations is " +
                                                           std::to_string(num_observations) +
                                                           ", not at least two per point");
  }
  return internal::CheckBalSizes("CollectionOptions", num_cameras, num_points, num_observations,
                                 0.0);
}

Status GenerateCollection(const CollectionOptions& options, const SceneProgress& progress,
                          SimulatedBal* scene) {
  if (Status status = options.Validate(); !status.ok()) {
    return status;
  }
  SimulatedBal result;
  Status status = internal::MakeCollection(options, progress, &result.problem);
  if (!status.ok()) {
    return status;
  }
  result.true_cameras = result.problem.cameras;
  result.true_points = result.problem.points;
  internal::AddNoise(options, options.seed, &result.problem, &result.outliers);
  *scene = std::move(result);
  return Status::Ok();
}

Status GetCollectionPreset(const std::string& name, CollectionOptions* options) {
  CollectionOptions preset;
  Status status = internal::ParseSizedPreset(name, "collection-", &preset.num_cameras);
  if (!status.ok()) {
    return status;
  }
  const double n = preset.num_cameras;
  const double share = std::log(n / 16.0) / std::log(kFinalCameras / 16.0);
  const double track_length = 2.9 + kGrowth * std::clamp(share, 0.0, 1.0);
  const double points = std::min(n, 1e6) * kFinalPoints / kFinalCameras;
  preset.num_points = static_cast<int>(points);
  const double observations = std::min(std::floor(points) * track_length, 2147483646.0);
  preset.num_observations =
      preset.num_cameras == kFinalCameras ? kFinalObservations : static_cast<int>(observations);
  status = preset.Validate();
  if (status.ok()) {
    *options = preset;
  }
  return status;
}

}  // namespace inceres
