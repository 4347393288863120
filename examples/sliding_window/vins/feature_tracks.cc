#include "vins/feature_tracks.h"

#include "common/triangulation.h"

namespace sliding_window {
namespace {

constexpr int kMinTracked = 20;
constexpr double kKeyframeParallax = 10.0 / 460.0;
constexpr double kGuessedDepth = 5.0;  // m

template <typename Predicate>
void EraseIf(std::map<int, FeatureTrack>* tracks, Predicate is_out) {
  for (auto track = tracks->begin(); track != tracks->end();) {
    track = is_out(&track->second) ? tracks->erase(track) : std::next(track);
  }
}

bool IsUsable(const FeatureTrack& track) {
  return track.xy.size() >= 2 && track.start < FeatureTracks::kNewest - 2;
}

}  // namespace

void FeatureTracks::Add(int frame, const std::vector<Observation>& observations) {
  for (const Observation& observation : observations) {
    const auto [track, is_new] = tracks_.try_emplace(observation.feature);
    if (is_new) {
      track->second.start = frame;
    }
    track->second.xy.push_back(observation.xy);
  }
}

bool FeatureTracks::SecondNewestIsKeyframe() const {
  int num_tracked = 0;
  int num_compared = 0;
  double parallax = 0.0;
  for (const auto& [number, track] : tracks_) {
    num_tracked += track.start < kNewest && track.last() == kNewest;
    if (track.start <= kNewest - 2 && track.last() >= kNewest - 1) {
      parallax +=
          (track.xy[kNewest - 1 - track.start] - track.xy[kNewest - 2 - track.start]).norm();
      ++num_compared;
    }
  }
  return num_tracked < kMinTracked || num_compared == 0 ||
         parallax >= kKeyframeParallax * num_compared;
}

std::vector<FeatureTrack*> FeatureTracks::Usable() {
  std::vector<FeatureTrack*> usable;
  for (auto& [number, track] : tracks_) {
    if (IsUsable(track)) {
      usable.push_back(&track);
    }
  }
  return usable;
}

void FeatureTracks::TriangulateNew(const std::vector<Pose>& world_from_camera) {
  for (FeatureTrack* track : Usable()) {
    if (track->inverse_depth > 0.0) {
      continue;
    }
    std::vector<Sight> sights;
    for (int frame = track->start; frame <= track->last(); ++frame) {
      sights.push_back({world_from_camera[frame], track->xy[frame - track->start]});
    }
    const auto point = Triangulate(sights);
    track->inverse_depth =
        1.0 / (point ? (world_from_camera[track->start].Inverse() * *point).z() : kGuessedDepth);
  }
}

void FeatureTracks::RemoveBehindCamera() {
  EraseIf(&tracks_, [](FeatureTrack* track) { return track->inverse_depth < 0.0; });
}

void FeatureTracks::RemoveOldest(const Pose& camera_0, const Pose& camera_1) {
  EraseIf(&tracks_, [&](FeatureTrack* track) {
    if (track->start > 0) {
      --track->start;
      return false;
    }
    if (track->inverse_depth > 0.0) {
      const Eigen::Vector3d point =
          camera_0 * (track->xy.front().homogeneous() / track->inverse_depth);
      const double depth = (camera_1.Inverse() * point).z();
      track->inverse_depth = depth > 0.0 ? 1.0 / depth : 0.0;
    }
    track->xy.erase(track->xy.begin());
    return track->xy.size() < 2;
  });
}

void FeatureTracks::RemoveSecondNewest() {
  EraseIf(&tracks_, [](FeatureTrack* track) {
    if (track->start == kNewest) {
      --track->start;
    } else if (track->last() >= kNewest - 1) {
      track->xy.erase(track->xy.begin() + (kNewest - 1 - track->start));
    }
    return track->xy.empty();
  });
}

}  // namespace sliding_window
