#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "inceres/io/bal.h"
#include "inceres/status.h"
#include "tools/sim/simulated_camera.h"

namespace inceres::internal {

/// A world whose cameras are known, in which points are placed.
class ObservedWorld {
 public:
  virtual ~ObservedWorld() = default;
  /// A random point in front of camera `anchor`, with all who could see it, the anchor first. False
  /// if there is no such point that a second camera sees well.
  virtual bool PlacePoint(int anchor, Random* random, CandidateTrack* track) const = 0;
  virtual int num_cameras() const = 0;
  virtual const SimulatedCamera& camera(int index) const = 0;
};

/// Shuffles the candidates behind the anchor, then brings the first that sees the position with
/// enough parallax to the second place. False if there is none.
bool OrderCandidates(const ObservedWorld& world, Random* random, CandidateTrack* track);

/// How many points and observations, and what to say where there is no room for them.
struct TrackCounts {
  int num_points = 0;
  int num_observations = 0;        ///< exactly; 0: as many as are drawn
  double mean_track_length = 0.0;  ///< of the lengths that are drawn
  std::string scene;               ///< "street scene"
  std::string remedy;              ///< "ask for …"
};

/// Told how many of so many points are placed.
using PointProgress = std::function<void(int points, int of_points)>;

/// Places the points, each camera being the anchor of its share of them, so that neighboring points
/// have neighboring indices, and fills `*truth` with the cameras, the points and exact projections,
/// sorted by point, then by camera. kInvalidArgument if the cameras do not see so much, or if one
/// of them sees fewer than ten points.
Status BuildTracks(const TrackCounts& counts, const ObservedWorld& world, std::uint64_t seed,
                   const PointProgress& progress, BalProblem* truth);

/// Ok if every camera sees at least ten points.
Status CheckPointsPerCamera(const BalProblem& problem, const TrackCounts& counts);

}  // namespace inceres::internal
