#pragma once

#include <vector>

#include "tools/sim/portable_math.h"
#include "tools/sim/vio_scene.h"

namespace inceres::internal {

/// A true point and the frames that see it, ascending.
struct VioTrack {
  Vector3 point{};
  std::vector<int> frames;
};

/// Places the points of a scene where the frames of the sequence, at their true poses, see them,
/// and decides who observes which: as many points and, if asked for, observations as the options
/// say.
class VioTracker {
 public:
  /// `sequence` has the camera and the frames' truth.
  VioTracker(const VioSceneOptions& options, const VioSequence& sequence);

  /// The tracks in the order in which they begin; or kInvalidArgument if the frames do not see so
  /// much.
  Status MakeTracks(std::vector<VioTrack>* tracks) const;

 private:
  bool PlacePoint(int anchor, Random* random, VioTrack* track) const;
  Vector3 RandomPosition(int anchor, Random* random) const;
  bool Sees(int frame, const Vector3& point) const;
  void CollectFrames(int anchor, bool recognized, Random* random, VioTrack* track) const;
  bool ChoosePartner(VioTrack* track) const;
  Status LimitTracks(std::vector<VioTrack>* tracks) const;

  const VioSceneOptions& options_;
  const VioSequence& sequence_;
  std::vector<Vector3> centers_;  // of the camera, in the world
  std::vector<Rotation> world_from_camera_;
  double min_parallax_;  // as 2 sin(angle / 2): the distance of unit vectors
};

}  // namespace inceres::internal
