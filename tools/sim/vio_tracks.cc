#include "tools/sim/vio_tracks.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "tools/sim/track_lengths.h"

namespace inceres::internal {
namespace {

constexpr int kMaxTries = 30;  // of places a frame

Vector3 PlaceOf(const std::array<double, 7>& pose) {
  return {pose[0], pose[1], pose[2]};
}

Rotation RotationOf(const std::array<double, 7>& pose) {
  return {pose[6], {pose[3], pose[4], pose[5]}};
}

Status Infeasible(const std::string& what) {
  return Status::Error(StatusCode::kInvalidArgument,
                       "visual-inertial scene: " + what +
                           "; ask for fewer, or for more frames, a larger max_depth, less dropout "
                           "or less min_parallax");
}

}  // namespace

VioTracker::VioTracker(const VioSceneOptions& options, const VioSequence& sequence)
    : options_(options),
      sequence_(sequence),
      min_parallax_(2.0 * PortableSin(0.5 * options.min_parallax)) {
  const std::array<double, 7>& camera = sequence.camera.imu_from_camera;
  for (const VioFrame& frame : sequence.frames) {
    const Rotation R_wb = RotationOf(frame.truth.pose);
    centers_.push_back(PlaceOf(frame.truth.pose) + R_wb * PlaceOf(camera));
    world_from_camera_.push_back(R_wb * RotationOf(camera));
  }
}

Status VioTracker::MakeTracks(std::vector<VioTrack>* tracks) const {
  Random random(options_.seed, 1);
  const std::int64_t num_frames = options_.num_frames;
  for (std::int64_t i = 0; i < options_.num_points; ++i) {
    // Each frame is the anchor of its share of the points; where it finds none, the next one that
    // does.
    const std::int64_t first = i * num_frames / options_.num_points;
    VioTrack track;
    std::int64_t skipped = 0;
    while (skipped < num_frames &&
           !PlacePoint(static_cast<int>((first + skipped) % num_frames), &random, &track)) {
      ++skipped;
    }
    if (skipped == num_frames) {
      return Infeasible("no frame finds a point that others see from another direction");
    }
    tracks->push_back(std::move(track));
  }
  if (Status status = LimitTracks(tracks); !status.ok()) {
    return status;
  }
  std::stable_sort(tracks->begin(), tracks->end(), [](const VioTrack& a, const VioTrack& b) {
    return a.frames.front() < b.frames.front();
  });
  return Status::Ok();
}

bool VioTracker::PlacePoint(int anchor, Random* random, VioTrack* track) const {
  const bool recognized = random->Uniform() < options_.loop_fraction;
  for (int attempt = 0; attempt < kMaxTries; ++attempt) {
    track->point = RandomPosition(anchor, random);
    if (!Sees(anchor, track->point)) {
      continue;
    }
    CollectFrames(anchor, recognized, random, track);
    if (ChoosePartner(track)) {
      return true;
    }
  }
  return false;
}

// Somewhere in the image of the anchor, were it not distorted.
Vector3 VioTracker::RandomPosition(int anchor, Random* random) const {
  const auto& [f_x, f_y, c_x, c_y] = sequence_.camera.intrinsics;
  const double u = random->Uniform(0.0, sequence_.camera.width),
               v = random->Uniform(0.0, sequence_.camera.height);
  const double depth = random->Uniform(options_.min_depth, options_.max_depth);
  const std::size_t i = static_cast<std::size_t>(anchor);
  return centers_[i] +
         world_from_camera_[i] * (depth * Vector3{(u - c_x) / f_x, (v - c_y) / f_y, 1.0});
}

bool VioTracker::Sees(int frame, const Vector3& point) const {
  const std::size_t i = static_cast<std::size_t>(frame);
  const double depth = (world_from_camera_[i].Inverse() * (point - centers_[i]))[2];
  double x = 0.0, y = 0.0;
  return depth >= options_.min_depth && depth <= options_.max_depth &&
         sequence_.Project(sequence_.frames[i].truth.pose, point, &x, &y) && x >= 0.0 &&
         x <= sequence_.camera.width && y >= 0.0 && y <= sequence_.camera.height;
}

// The anchor, then the frames around it until it goes out of view and, if it is recognized, all
// others that see it: on one side of the anchor, then on the other, whichever comes first. In some
// of them, but not in the anchor, it is not detected.
void VioTracker::CollectFrames(int anchor, bool recognized, Random* random, VioTrack* track) const {
  track->frames.assign(1, anchor);
  const int first_step = random->Uniform() < 0.5 ? 1 : -1;
  for (const int step : {first_step, -first_step}) {
    bool in_view = true;
    for (int frame = anchor + step;
         frame >= 0 && frame < options_.num_frames && (in_view || recognized); frame += step) {
      const bool seen = Sees(frame, track->point);
      in_view = in_view && seen;
      if (seen && random->Uniform() >= options_.dropout) {
        track->frames.push_back(frame);
      }
    }
  }
}

// Brings the first frame that sees it from a direction different enough from the anchor's to the
// second place.
bool VioTracker::ChoosePartner(VioTrack* track) const {
  const auto direction = [&](int frame) {
    const Vector3 ray = track->point - centers_[static_cast<std::size_t>(frame)];
    return (1.0 / std::sqrt(Dot(ray, ray))) * ray;
  };
  const auto begin = track->frames.begin(), end = track->frames.end();
  const Vector3 from_anchor = direction(*begin);
  const auto partner = std::find_if(begin + 1, end, [&](int frame) {
    const Vector3 change = direction(frame) - from_anchor;
    return Dot(change, change) >= min_parallax_ * min_parallax_;
  });
  if (partner == end) {
    return false;
  }
  std::rotate(begin + 1, partner, partner + 1);
  return true;
}

// Any first two or more frames of a track are a track.
Status VioTracker::LimitTracks(std::vector<VioTrack>* tracks) const {
  std::vector<int> lengths, longest;
  for (const VioTrack& track : *tracks) {
    longest.push_back(std::min(static_cast<int>(track.frames.size()), options_.max_track_length));
  }
  if (options_.num_observations == 0) {
    lengths = longest;
  } else {
    Random random(options_.seed, 2);
    const double mean = static_cast<double>(options_.num_observations) / options_.num_points;
    for (const int most : longest) {
      lengths.push_back(std::min(DrawTrackLength(mean, &random), most));
    }
    if (const std::int64_t missing =
            AdjustTrackLengths(options_.num_observations, longest, &lengths);
        missing != 0) {
      return Infeasible(
          "the frames make at most " + std::to_string(options_.num_observations - missing) +
          " observations of the " + std::to_string(options_.num_observations) + " asked for");
    }
  }
  for (std::size_t i = 0; i < lengths.size(); ++i) {
    std::vector<int>& frames = (*tracks)[i].frames;
    frames.resize(static_cast<std::size_t>(lengths[i]));
    std::sort(frames.begin(), frames.end());
  }
  return Status::Ok();
}

}  // namespace inceres::internal
