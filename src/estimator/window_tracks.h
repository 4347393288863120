#pragma once

#include <cstdint>
#include <map>
#include <vector>

#include "estimator/window_graph.h"

namespace inceres::internal {

/// A feature through the frames of the window, in their order. With a landmark, the first view is
/// from its anchor.
struct Track {
  VariableId landmark = -1;
  std::vector<View> views;

  bool has_landmark() const { return landmark >= 0; }
  /// Its view from a frame, or the end of the views.
  std::vector<View>::const_iterator ViewFrom(std::int64_t frame) const;
};

/// The tracks of a window, by their numbers; each has a view. Cheap enough to copy: changes are
/// made to a copy, along with an edit of the graph, and kept if the edit is carried out.
class WindowTracks {
 public:
  using Map = std::map<std::int64_t, Track>;

  Map& all() { return tracks_; }
  const Map& all() const { return tracks_; }
  /// Null if there is none.
  const Track* Find(std::int64_t track) const;

  int CountKnown(const std::vector<WindowObservation>& observations) const;
  int CountLandmarks() const;
  /// The mean distance in the image between the views of two frames, over the tracks that both see;
  /// infinite if there are none.
  double Parallax(std::int64_t frame_a, std::int64_t frame_b) const;

  /// The oldest frame has left: its views go, and tracks whose landmark went with it, all of whose
  /// views are in the prior now.
  void ForgetOldest(std::int64_t frame);

 private:
  Map tracks_;
};

}  // namespace inceres::internal
