#include "inceres/sim/street_scene.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "sim/scene_noise.h"
#include "sim/street_limits.h"
#include "sim/street_view.h"

namespace inceres {
namespace internal {
namespace {

constexpr int kMinPointsPerCamera = 10;
constexpr int kMaxSpacings = 6;

Status Infeasible(const std::string& what) {
  return Status::Error(
      StatusCode::kInvalidArgument,
      "street scene: " + what +
          "; ask for fewer observations per point, more points per camera, or (if laps > 0) more cameras per lap or a "
          "larger loop_fraction");
}

// Builds the true scene for one distance between cameras.
class SceneBuilder {
 public:
  SceneBuilder(const StreetSceneOptions& options, double spacing) : options_(options), view_(options, spacing) {}

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
  // Each camera is the anchor of its share of the points, so that neighbouring points have neighbouring indices.
  Status PlacePoints() {
    Random random(options_.seed, 2);
    points_.resize(static_cast<std::size_t>(options_.num_points));
    for (std::size_t i = 0; i < points_.size(); ++i) {
      const int anchor = static_cast<int>(static_cast<std::int64_t>(i) * options_.num_cameras / options_.num_points);
      if (!view_.PlacePoint(anchor, &random, &points_[i])) {
        return Infeasible("camera " + std::to_string(anchor) +
                          " finds no point that another camera sees from a different direction");
      }
      lengths_.push_back(std::min(DrawLength(&random), static_cast<int>(points_[i].candidates.size())));
    }
    return Status::Ok();
  }

  // 2 + a geometric distribution with the mean that is wanted: many short tracks and a few long ones, as in real data.
  int DrawLength(Random* random) const {
    const double mean_extra = options_.MeanTrackLength() - 2.0;
    if (mean_extra <= 0.0) {
      return 2;
    }
    const double log_continue = PortableLog(mean_extra / (1.0 + mean_extra));
    const double extra = std::floor(PortableLog(1.0 - random->Uniform()) / log_continue);
    return 2 + static_cast<int>(std::min(extra, 1e6));
  }

  // Rounds over the points that lengthen or shorten tracks by one until the total is what was asked for, if it was.
  Status ChooseTrackLengths() {
    if (options_.num_observations == 0) {
      return Status::Ok();
    }
    std::int64_t missing = options_.num_observations;
    for (const int length : lengths_) {
      missing -= length;
    }
    const int step = missing > 0 ? 1 : -1;
    for (bool moved = true; missing != 0 && moved;) {
      moved = false;
      for (std::size_t i = 0; i < points_.size() && missing != 0; ++i) {
        const int length = lengths_[i] + step;
        if (length >= 2 && length <= static_cast<int>(points_[i].candidates.size())) {
          lengths_[i] = length;
          missing -= step;
          moved = true;
        }
      }
    }
    return missing == 0
               ? Status::Ok()
               : Infeasible("in this street the cameras make at most " + std::to_string(options_.num_observations - missing) +
                            " observations of the " + std::to_string(options_.num_observations) + " asked for");
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
      truth->points.insert(truth->points.end(), points_[i].position.begin(), points_[i].position.end());
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
    return Infeasible("camera " + std::to_string(least - seen.begin()) + " sees only " + std::to_string(*least) +
                      " points of at least " + std::to_string(kMinPointsPerCamera));
  }

  const StreetSceneOptions& options_;
  StreetView view_;
  std::vector<StreetPoint> points_;
  std::vector<int> lengths_;
};

// So that about twice as many cameras see a point as its mean track is long: room to make the counts exact.
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
  const double least = automatic ? internal::kMinCircumference * options.laps / options.num_cameras : 0.0;
  double spacing = std::max(automatic ? internal::WishedSpacing(options) : options.camera_spacing, least);
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
