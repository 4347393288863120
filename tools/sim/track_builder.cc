#include "tools/sim/track_builder.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "tools/sim/scene_noise.h"
#include "tools/sim/track_lengths.h"

namespace inceres::internal {
namespace {

constexpr int kMinPointsPerCamera = 10;
constexpr double kCosMinParallax = 0.99939082701909573;  // 2 degrees

Status Infeasible(const TrackCounts& counts, const std::string& what) {
  return Status::Error(StatusCode::kInvalidArgument,
                       counts.scene + ": " + what + "; " + counts.remedy);
}

class TrackBuilder {
 public:
  TrackBuilder(const TrackCounts& counts, const ObservedWorld& world)
      : counts_(counts), world_(world) {}

  Status PlacePoints(std::uint64_t seed, const PointProgress& progress) {
    Random random(seed, 2);
    points_.resize(static_cast<std::size_t>(counts_.num_points));
    for (int i = 0; i < counts_.num_points; ++i) {
      CandidateTrack& point = points_[static_cast<std::size_t>(i)];
      const int anchor = static_cast<int>(static_cast<std::int64_t>(i) * world_.num_cameras() /
                                          counts_.num_points);
      if (!world_.PlacePoint(anchor, &random, &point)) {
        return Infeasible(counts_, "camera " + std::to_string(anchor) +
                                       " finds no point that another camera sees from a different "
                                       "direction");
      }
      lengths_.push_back(std::min(DrawTrackLength(counts_.mean_track_length, &random),
                                  static_cast<int>(point.candidates.size())));
      if (progress) {
        progress(i + 1, counts_.num_points);
      }
    }
    return Status::Ok();
  }

  Status ChooseTrackLengths() {
    if (counts_.num_observations == 0) {
      return Status::Ok();
    }
    std::vector<int> longest;
    for (const CandidateTrack& point : points_) {
      longest.push_back(static_cast<int>(point.candidates.size()));
    }
    const std::int64_t missing = AdjustTrackLengths(counts_.num_observations, longest, &lengths_);
    return missing == 0
               ? Status::Ok()
               : Infeasible(counts_, "in this street the cameras make at most " +
                                         std::to_string(counts_.num_observations - missing) +
                                         " observations of the " +
                                         std::to_string(counts_.num_observations) + " asked for");
  }

  void Assemble(BalProblem* truth) {
    truth->num_cameras = world_.num_cameras();
    truth->num_points = counts_.num_points;
    for (int i = 0; i < world_.num_cameras(); ++i) {
      const auto parameters = ToBal(world_.camera(i));
      truth->cameras.insert(truth->cameras.end(), parameters.begin(), parameters.end());
    }
    truth->observations.reserve(static_cast<std::size_t>(counts_.num_observations));
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

 private:
  const TrackCounts& counts_;
  const ObservedWorld& world_;
  std::vector<CandidateTrack> points_;
  std::vector<int> lengths_;
};

}  // namespace

bool HaveParallax(const Vector3& center, const Vector3& other_center, const Vector3& position) {
  const Vector3 a = position - center, b = position - other_center;
  return Dot(a, b) <= kCosMinParallax * std::sqrt(Dot(a, a) * Dot(b, b));
}

bool OrderCandidates(const ObservedWorld& world, Random* random, CandidateTrack* track) {
  std::vector<int>& candidates = track->candidates;
  const int size = static_cast<int>(candidates.size());
  for (int i = size - 1; i > 1; --i) {
    const int other = 1 + random->Below(i);
    std::swap(candidates[static_cast<std::size_t>(i)], candidates[static_cast<std::size_t>(other)]);
  }
  const Vector3& anchor = world.camera(candidates[0]).center;
  for (std::size_t i = 1; i < candidates.size(); ++i) {
    if (HaveParallax(anchor, world.camera(candidates[i]).center, track->position)) {
      std::swap(candidates[1], candidates[i]);
      return true;
    }
  }
  return false;
}

Status CheckPointsPerCamera(const BalProblem& problem, const TrackCounts& counts) {
  std::vector<int> seen(static_cast<std::size_t>(problem.num_cameras));
  for (const BalObservation& observation : problem.observations) {
    ++seen[static_cast<std::size_t>(observation.camera)];
  }
  const auto least = std::min_element(seen.begin(), seen.end());
  if (*least >= kMinPointsPerCamera) {
    return Status::Ok();
  }
  return Infeasible(counts, "camera " + std::to_string(least - seen.begin()) + " sees only " +
                                std::to_string(*least) + " points of at least " +
                                std::to_string(kMinPointsPerCamera));
}

Status BuildTracks(const TrackCounts& counts, const ObservedWorld& world, std::uint64_t seed,
                   const PointProgress& progress, BalProblem* truth) {
  TrackBuilder builder(counts, world);
  Status status = builder.PlacePoints(seed, progress);
  if (status.ok()) {
    status = builder.ChooseTrackLengths();
  }
  if (!status.ok()) {
    return status;
  }
  builder.Assemble(truth);
  return CheckPointsPerCamera(*truth, counts);
}

}  // namespace inceres::internal
