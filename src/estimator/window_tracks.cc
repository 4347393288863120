#include "estimator/window_tracks.h"

#include <algorithm>
#include <cmath>
#include <limits>

// Tracks of features through the window, apart from the graph. A map, not a hash: it is walked in
// the order of the track numbers when edits are made, so variables and factors get the same ids,
// and sums the same order, in every run. Views are in the order of the frames, and there are few of
// them: searches are linear.

namespace inceres::internal {

std::vector<View>::const_iterator Track::ViewFrom(std::int64_t frame) const {
  return std::find_if(views.begin(), views.end(),
                      [frame](const View& view) { return view.frame == frame; });
}

const Track* WindowTracks::Find(std::int64_t track) const {
  const auto found = tracks_.find(track);
  return found == tracks_.end() ? nullptr : &found->second;
}

// Known with or without a landmark: what counts is that the tracker has followed it.
int WindowTracks::CountKnown(const std::vector<WindowObservation>& observations) const {
  return static_cast<int>(std::count_if(
      observations.begin(), observations.end(),
      [this](const WindowObservation& seen) { return tracks_.count(seen.track) > 0; }));
}

int WindowTracks::CountLandmarks() const {
  return static_cast<int>(std::count_if(tracks_.begin(), tracks_.end(), [](const auto& entry) {
    return entry.second.has_landmark();
  }));
}

// Of where points are seen: what rotation alone moves counts too. With no track in common nothing
// is known of the motion, and infinity makes the frame a keyframe.
double WindowTracks::Parallax(std::int64_t frame_a, std::int64_t frame_b) const {
  double sum = 0.0;
  int count = 0;
  for (const auto& [number, track] : tracks_) {
    const auto a = track.ViewFrom(frame_a), b = track.ViewFrom(frame_b);
    if (a != track.views.end() && b != track.views.end()) {
      sum += std::hypot(a->point[0] - b->point[0], a->point[1] - b->point[1]);
      ++count;
    }
  }
  return count > 0 ? sum / count : std::numeric_limits<double>::infinity();
}

// The views of a landmark that was anchored in the oldest frame are all in the prior: the track
// ends, or it would count them again. The next view of it begins a track with the same number. A
// track without a landmark has no factors and only loses its first view.
void WindowTracks::ForgetOldest(std::int64_t frame) {
  for (auto entry = tracks_.begin(); entry != tracks_.end();) {
    Track& track = entry->second;
    // Views are in the order of frames, so one from the oldest is the first.
    const bool seen = track.views.front().frame == frame;
    if (seen && !track.has_landmark()) {
      track.views.erase(track.views.begin());
    }
    const bool gone = track.views.empty() || (seen && track.has_landmark());
    entry = gone ? tracks_.erase(entry) : std::next(entry);
  }
}

}  // namespace inceres::internal
