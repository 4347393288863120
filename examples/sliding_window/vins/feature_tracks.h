#pragma once

#include <map>
#include <vector>

#include <Eigen/Core>

#include "common/frame.h"

namespace sliding_window {

/// A feature followed through consecutive frames of the window.
struct FeatureTrack {
  int start = 0;                    // the window's frame that saw it first
  std::vector<Eigen::Vector2d> xy;  // in frames start, start + 1, ...
  double inverse_depth = 0.0;       // in frame `start`; 0 if not known yet

  int last() const { return start + static_cast<int>(xy.size()) - 1; }
};

/// The features that the window's frames 0 .. kNewest see.
class FeatureTracks {
 public:
  static constexpr int kNewest = 10;

  void Add(int frame, const std::vector<Observation>& observations);

  /// Whether the frame before the newest saw enough that is new to be kept: few features that were
  /// known, or much parallax to the frame before it.
  bool SecondNewestIsKeyframe() const;

  /// The tracks worth a variable: seen twice, and long enough ago to be seen again. In order of
  /// their numbers.
  std::vector<FeatureTrack*> Usable();

  /// Gives every usable track without a depth one, from lines of sight, or a guess where those are
  /// too parallel.
  void TriangulateNew(const std::vector<Pose>& world_from_camera);
  /// Forgets tracks whose depth came out negative.
  void RemoveBehindCamera();

  /// Frame 0 leaves; what it saw first is described from frame 1 on.
  void RemoveOldest(const Pose& camera_0, const Pose& camera_1);
  /// The frame before the newest leaves and the newest takes its place.
  void RemoveSecondNewest();

 private:
  std::map<int, FeatureTrack> tracks_;
};

}  // namespace sliding_window
