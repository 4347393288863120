#include "tools/sim/street_scene.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "tools/sim/scene_noise.h"
#include "tools/sim/street_limits.h"
#include "tools/sim/street_view.h"
#include "tools/sim/track_builder.h"

namespace inceres {
namespace internal {
namespace {

constexpr int kMaxSpacings = 6;

// Builds the true scene for one distance between cameras.
Status Build(const StreetSceneOptions& options, double spacing, BalProblem* truth) {
  TrackCounts counts;
  counts.num_points = options.num_points;
  counts.num_observations = options.num_observations;
  counts.mean_track_length = options.MeanTrackLength();
  counts.scene = "street scene";
  counts.remedy =
      "ask for fewer observations per point, more points per camera, or (if laps > 0) more cameras "
      "per lap or a larger loop_fraction";
  return BuildTracks(counts, StreetView(options, spacing), options.seed, nullptr, truth);
}

// So that about twice as many cameras see a point as its mean track is long: room to make the
// counts exact.
double WishedSpacing(const StreetSceneOptions& options) {
  return kVisibleLength / (2.0 * options.MeanTrackLength() + 2.0);
}

}  // namespace
}  // namespace internal

Status GenerateStreetScene(const StreetSceneOptions& options, StreetScene* scene) {
  if (Status status = options.Validate(); !status.ok()) {
    return status;
  }
  const bool automatic = options.camera_spacing == 0.0;
  const double least =
      automatic ? internal::kMinCircumference * options.laps / options.num_cameras : 0.0;
  double spacing =
      std::max(automatic ? internal::WishedSpacing(options) : options.camera_spacing, least);
  StreetScene result;
  Status status = internal::Build(options, spacing, &result.truth);
  for (int i = 1; !status.ok() && automatic && spacing > least && i < internal::kMaxSpacings; ++i) {
    spacing = std::max(0.7 * spacing, least);
    result.truth = BalProblem();
    status = internal::Build(options, spacing, &result.truth);
  }
  if (status.ok()) {
    result.problem = result.truth;
    internal::AddNoise(options, options.seed, &result.problem, &result.outliers);
    *scene = std::move(result);
  }
  return status;
}

}  // namespace inceres
