#pragma once

#include <cstdint>
#include <string>

#include "inceres/status.h"
#include "tools/sim/bal_noise.h"
#include "tools/sim/city_scene.h"
#include "tools/sim/simulated_bal.h"

namespace inceres {

/// A simulated collection of photos from the internet. All three counts come out exactly.
struct CollectionOptions : BalNoise {
  int num_cameras = 1000;          ///< 20 .. 1,000,000
  int num_points = 325700;         ///< at least 1
  int num_observations = 1600000;  ///< at least two per point

  std::uint64_t seed = 1;

  /// Ok, or kInvalidArgument naming the field, its value and the range.
  Status Validate() const;
};

/// Simulates photos that many people took of the sights of a city, in no order: a few sights are on
/// thousands of them and most on dozens (a sight's share falls with its rank r as r^−0.8), every
/// sixth photo is taken from afar and shows several. Cameras differ in focal length by factors. Who
/// sees a point is random among those who stand on its side. Track lengths have a heavy tail: the
/// probability of more than k is (2 / k)^α, with the α that gives the mean, up to a fifth of those
/// who have the sight in view. Photos differ by factors in the number of points they are the first
/// to see.
///
/// Synthetic: the counts may be those of a known problem; its photos are not in it.
///
/// Points are sorted by sight, those of the most photographed one last. Start values are the truth
/// plus the noise of each camera and point by itself. Deterministic as GenerateStreetScene.
/// Failure: kInvalidArgument if the options do not Validate(), or ask for more than the cameras
/// see; `*scene` is then unchanged. Memory: that of the result. Threads: no shared state.
Status GenerateCollection(const CollectionOptions& options, const SceneProgress& progress,
                          SimulatedBal* scene);

/// The preset "collection-N": N cameras, with 325.7 points each and 2.9 observations a point (16
/// cameras) to 6.5, in proportion to log N. 13682: the counts of the largest public problem, 13,682
/// cameras, 4,456,117 points and 28,987,644 observations. kInvalidArgument unless N is a number in
/// range.
Status GetCollectionPreset(const std::string& name, CollectionOptions* options);

}  // namespace inceres
