#include "tools/sim/collection_tracks.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>
#include <vector>

#include "tools/sim/collection_view.h"
#include "tools/sim/heavy_tail.h"
#include "tools/sim/scene_noise.h"
#include "tools/sim/track_builder.h"

namespace inceres::internal {
namespace {

constexpr int kMaxTries = 50;        // places that one point is tried at
constexpr int kViewersPerTrack = 5;  // a track has at most this part of who has the sight in view
// Points that a camera is the first to see: this share of them all alike, the others by factors.
constexpr double kEvenShare = 0.2, kSpread = 0.7;
// Long tracks are no longer drawn where so few points are left that they could not make up for it.
constexpr int kLastPoints = 1000;

class CollectionBuilder {
 public:
  CollectionBuilder(const CollectionOptions& options, const TrackCounts& counts, BalProblem* truth)
      : options_(options),
        counts_(counts),
        view_(options.num_cameras, options.seed),
        random_(options.seed, 2),
        truth_(*truth) {}

  Status Build(const SceneProgress& progress) {
    AddCameras();
    CountPoints();
    const HeavyTail lengths = MakeLengths();
    expected_left_ = lengths.ExpectedSum();
    for (int sight = 0; sight < view_.num_sights(); ++sight) {
      if (Status status = AddPointsOf(sight, lengths, progress); !status.ok()) {
        return status;
      }
    }
    return missing_ == 0
               ? Status::Ok()
               : Infeasible("the cameras make " +
                            std::to_string(options_.num_observations - missing_) +
                            " observations, not " + std::to_string(options_.num_observations));
  }

 private:
  Status Infeasible(const std::string& what) const {
    return Status::Error(StatusCode::kInvalidArgument,
                         counts_.scene + ": " + what + "; " + counts_.remedy);
  }

  void AddCameras() {
    truth_.num_cameras = options_.num_cameras;
    for (const SimulatedCamera& camera : view_.cameras()) {
      const auto parameters = ToBal(camera);
      truth_.cameras.insert(truth_.cameras.end(), parameters.begin(), parameters.end());
    }
    truth_.num_points = options_.num_points;
    truth_.points.reserve(3 * static_cast<std::size_t>(options_.num_points));
    truth_.observations.reserve(static_cast<std::size_t>(options_.num_observations));
  }

  // points_of_: how many each camera is the first to see. The sum is exact.
  void CountPoints() {
    std::vector<double> weights;
    for (int i = 0; i < options_.num_cameras; ++i) {
      const double spread = PortableExp(kSpread * std::clamp(random_.Normal(), -2.5, 2.5));
      weights.push_back(kEvenShare + (1.0 - kEvenShare) * spread);
    }
    const double sum = std::accumulate(weights.begin(), weights.end(), 0.0);
    double seen = 0.0;
    std::int64_t begin = 0;
    for (std::size_t i = 0; i < weights.size(); ++i) {
      seen += weights[i];
      const std::int64_t end = i + 1 == weights.size()
                                   ? options_.num_points
                                   : static_cast<std::int64_t>(options_.num_points * (seen / sum));
      points_of_.push_back(static_cast<int>(end - begin));
      begin = end;
    }
  }

  int Limit(int sight) const {
    return std::max(2, static_cast<int>(view_.Viewers(sight).size()) / kViewersPerTrack);
  }

  HeavyTail MakeLengths() {
    std::vector<int> limits;
    std::vector<std::int64_t> draws(static_cast<std::size_t>(view_.num_sights()));
    limits.reserve(draws.size());
    for (int sight = 0; sight < view_.num_sights(); ++sight) {
      limits.push_back(Limit(sight));
    }
    for (int i = 0; i < options_.num_cameras; ++i) {
      draws[static_cast<std::size_t>(view_.SightOf(i))] += points_of_[static_cast<std::size_t>(i)];
    }
    return {static_cast<double>(options_.num_observations) / options_.num_points, limits, draws};
  }

  Status AddPointsOf(int sight, const HeavyTail& lengths, const SceneProgress& progress) {
    std::vector<int> viewers = view_.Viewers(sight);
    const std::vector<int> anchors = viewers;
    const int limit = Limit(sight);
    const int short_length = 1 + 2 * options_.num_observations / options_.num_points;
    for (const int anchor : anchors) {
      if (view_.SightOf(anchor) != sight) {
        continue;
      }
      for (int k = 0; k < points_of_[static_cast<std::size_t>(anchor)]; ++k) {
        int length = lengths.Draw(limit, &random_);
        if (options_.num_points - NumPoints() <= kLastPoints) {
          length = std::min(length, short_length);
        }
        if (!AddPoint(anchor, length, &viewers)) {
          return Infeasible("camera " + std::to_string(anchor) +
                            " finds no point that another camera sees from a different direction");
        }
        expected_left_ -= lengths.Expected(limit);
        if (progress) {
          progress(NumPoints(), options_.num_points);
        }
      }
    }
    return Status::Ok();
  }

  // One more point, as often seen as was drawn, and a little more or less: what is left to observe
  // and what is expected to be drawn yet differ, and each point takes its share of the difference.
  bool AddPoint(int anchor, int drawn, std::vector<int>* viewers) {
    const std::int64_t rest = options_.num_points - NumPoints();
    const auto left = static_cast<double>(missing_);
    expected_left_ = std::max(0.0, expected_left_);
    correction_ += (left - expected_left_) / static_cast<double>(rest);
    const double correction = std::floor(correction_);
    std::int64_t wanted = std::max<std::int64_t>(2, drawn + static_cast<std::int64_t>(correction));
    wanted = rest == 1 ? missing_ : std::min(wanted, missing_ - 2 * (rest - 1));
    for (int attempt = 0; attempt < kMaxTries; ++attempt) {
      Vector3 position{}, normal{};
      if (view_.RandomPosition(anchor, &random_, &position, &normal) &&
          CollectTrack(anchor, position, normal, static_cast<std::size_t>(wanted), viewers)) {
        correction_ -= static_cast<double>(wanted - drawn);
        Append(position);
        return true;
      }
    }
    return false;
  }

  int NumPoints() const { return static_cast<int>(truth_.points.size() / 3); }

  // At random among the viewers, those before `i` being dealt with already.
  bool CollectTrack(int anchor, const Vector3& position, const Vector3& normal, std::size_t wanted,
                    std::vector<int>* viewers) {
    track_.assign(1, anchor);
    const Vector3& from = view_.cameras()[static_cast<std::size_t>(anchor)].center;
    const auto size = static_cast<int>(viewers->size());
    for (int i = 0; i < size && track_.size() < wanted; ++i) {
      int& next = (*viewers)[static_cast<std::size_t>(i)];
      const int other = i + random_.Below(size - i);
      std::swap(next, (*viewers)[static_cast<std::size_t>(other)]);
      const Vector3& center = view_.cameras()[static_cast<std::size_t>(next)].center;
      if (next != anchor && view_.Sees(next, position, normal) &&
          (track_.size() > 1 || HaveParallax(from, center, position))) {
        track_.push_back(next);
      }
    }
    std::sort(track_.begin(), track_.end());
    return track_.size() > 1;
  }

  void Append(const Vector3& position) {
    const int index = NumPoints();
    truth_.points.insert(truth_.points.end(), position.begin(), position.end());
    for (const int camera : track_) {
      truth_.observations.push_back({camera, index, 0.0, 0.0});
    }
    missing_ -= static_cast<std::int64_t>(track_.size());
  }

  const CollectionOptions& options_;
  const TrackCounts& counts_;
  const CollectionView view_;
  Random random_;
  BalProblem& truth_;
  std::vector<int> points_of_;
  std::vector<int> track_;
  std::int64_t missing_ = options_.num_observations;  // observations
  double expected_left_ = 0.0;                        // of the draws that are to come
  double correction_ = 0.0;                           // that is due
};

}  // namespace

Status MakeCollection(const CollectionOptions& options, const SceneProgress& progress,
                      BalProblem* truth) {
  TrackCounts counts;
  counts.scene = "collection";
  counts.remedy = "ask for fewer observations per point, or more points per camera";
  Status status = CollectionBuilder(options, counts, truth).Build(progress);
  if (!status.ok()) {
    return status;
  }
  ProjectAll(truth);
  return CheckPointsPerCamera(*truth, counts);
}

}  // namespace inceres::internal
