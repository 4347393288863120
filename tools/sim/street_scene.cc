#include "tools/sim/street_scene.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "tools/sim/scene_noise.h"
#include "tools/sim/street_limits.h"
#include "tools/sim/street_view.h"
#include "tools/sim/track_lengths.h"

namespace inceres {
namespace internal {
namespace {

constexpr int kMinPointsPerCamera = 10;
constexpr int kMaxSpacings = 6;

Status Infeasible(const std::string& what) {
  return Status::Error(StatusCode::kInvalidArgument,
                       "street scene: " + what +
                           "; ask for fewer observations per point, more points per camera, or (if "
                           "laps > 0) more cameras per lap or a "
                           "larger loop_fraction");
}

// Builds the true scene for one distance between cameras.
class SceneBuilder {
 public:
  SceneBuilder(const StreetSceneOptions& options, double spacing)
      : options_(options), view_(options, spacing) {}

  Status Build(BalProblem* truth) {
    if (Status status = PlacePoints(); !status.ok()) {
      return status;
    }
    if (Status status = ChooseTrackLengths(); !status.ok()) {
      return status;
    }
    Assemble(truth);
    return CheckCameras(*truth);
  }

 private:
  // Each camera is the anchor of its share of the points, so that neighboring points have
  // neighboring indices.
  Status PlacePoints() {
    Random random(options_.seed, 2);
    points_.resize(static_cast<std::size_t>(options_.num_points));
    for (std::size_t i = 0; i < points_.size(); ++i) {
      const int anchor = static_cast<int>(static_cast<std::int64_t>(i) * options_.num_cameras /
                                          options_.num_points);
      if (!view_.PlacePoint(anchor, &random, &points_[i])) {
        return Infeasible("camera " + std::to_string(anchor) +
                          " finds no point that another camera sees from a different direction");
      }
      lengths_.push_back(std::min(DrawTrackLength(options_.MeanTrackLength(), &random),
                                  static_cast<int>(points_[i].candidates.size())));
    }
    return Status::Ok();
  }

  Status ChooseTrackLengths() {
    if (options_.num_observations == 0) {
      return Status::Ok();
    }
    std::vector<int> longest;
    for (const StreetPoint& point : points_) {
      longest.push_back(static_cast<int>(point.candidates.size()));
    }
    const std::int64_t missing = AdjustTrackLengths(options_.num_observations, longest, &lengths_);
    return missing == 0 ? Status::Ok()
                        : Infeasible("in this street the cameras make at most " +
                                     std::to_string(options_.num_observations - missing) +
                                     " observations of the " +
                                     std::to_string(options_.num_observations) + " asked for");
  }

  void Assemble(BalProblem* truth) {
    truth->num_cameras = options_.num_cameras;
    truth->num_points = options_.num_points;
    for (const StreetCamera& camera : view_.cameras()) {
      const auto parameters = ToBal(camera);
      truth->cameras.insert(truth->cameras.end(), parameters.begin(), parameters.end());
    }
    truth->observations.reserve(static_cast<std::size_t>(options_.num_observations));
    for (std::size_t i = 0; i < points_.size(); ++i) {
      truth->points.insert(truth->points.end(), points_[i].position.begin(),
                           points_[i].position.end());
      std::vector<int>& track = points_[i].candidates;
      track.resize(static_cast<std::size_t>(lengths_[i]));
      std::sort(track.begin(), track.end());
      for (const int camera : track) {
        truth->observations.push_back({camera, static_cast<int>(i), 0.0, 0.0});
      }
    }
    ProjectAll(truth);
  }

  static Status CheckCameras(const BalProblem& truth) {
    std::vector<int> seen(static_cast<std::size_t>(truth.num_cameras));
    for (const BalObservation& observation : truth.observations) {
      ++seen[static_cast<std::size_t>(observation.camera)];
    }
    const auto least = std::min_element(seen.begin(), seen.end());
    if (*least >= kMinPointsPerCamera) {
      return Status::Ok();
    }
    return Infeasible("camera " + std::to_string(least - seen.begin()) + " sees only " +
                      std::to_string(*least) + " points of at least " +
                      std::to_string(kMinPointsPerCamera));
  }

  const StreetSceneOptions& options_;
  StreetView view_;
  std::vector<StreetPoint> points_;
  std::vector<int> lengths_;
};

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
  Status status = internal::SceneBuilder(options, spacing).Build(&result.truth);
  for (int i = 1; !status.ok() && automatic && spacing > least && i < internal::kMaxSpacings; ++i) {
    spacing = std::max(0.7 * spacing, least);
    result.truth = BalProblem();
    status = internal::SceneBuilder(options, spacing).Build(&result.truth);
  }
  if (status.ok()) {
    internal::AddNoise(options, &result);
    *scene = std::move(result);
  }
  return status;
}

}  // namespace inceres
