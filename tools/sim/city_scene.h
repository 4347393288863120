#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "inceres/status.h"
#include "tools/sim/bal_noise.h"
#include "tools/sim/simulated_bal.h"

namespace inceres {

/// What a simulated city looks like and how far its start values have drifted. Lengths in meters,
/// angles in radians.
struct CityOptions : BalNoise {
  int num_cameras = 1000;  ///< 20 .. 1,000,000
  int num_points = 20000;  ///< at least 1
  /// exactly, at least two per point; 0: as many as are drawn, see track_length
  int num_observations = 0;
  /// the mean of the track lengths that are drawn, 2 .. 1000; 0: 5 on a street of 16 m, and in
  /// proportion to the width on others, but at least 3
  double track_length = 0.0;

  double camera_spacing = 2.0;  ///< from camera to camera along the route, 0.1 .. 20
  /// From facade to facade, 8 .. 200. On a wide street one sees far, so that more cameras see a
  /// point, and more cameras have points in common.
  double street_width = 16.0;
  double block_length = 60.0;  ///< of the side of a block of houses, 20 .. 1000
  /// Share of the points that are recognized by a camera that comes by at another time, or crosses,
  /// 0 .. 1.
  double loop_fraction = 0.3;
  /// How far the start values drift: 1 for 0.005 rad about each axis, 1 % of scale and 0.1 m along
  /// each axis (standard deviations) from crossing to crossing, accumulating; 0: not at all;
  /// 0 .. 20.
  double drift = 1.0;

  std::uint64_t seed = 1;

  /// track_length, or what it is where that is 0.
  double MeanTrackLength() const;
  /// Ok, or kInvalidArgument naming the field, its value and the range.
  Status Validate() const;
};

/// Called with how many of so many points are placed.
using SceneProgress = std::function<void(int points, int of_points)>;

/// Simulates a camera that is driven through the streets of a city of square blocks, each crossing
/// taken straight on or around a corner at random, streets that were driven less often first: about
/// 1.3 times as much is driven as there are streets. So there are loops of all lengths, from around
/// a block to around the city, and between two cameras the way is as far as the city is wide.
/// Points lie on facades and the ground; houses hide what is behind them. Cameras see what is near,
/// in front, and not hidden; a camera that passes at another time sees those points that can be
/// recognized.
///
/// Start values drift over long distances and hardly over short ones. From the first crossing on,
/// each crossing moves as the similarity of those before it says, to the west and to the south, and
/// a random similarity on each of the two streets; of the two the mean: loops are closed, roughly,
/// and errors of direction and of scale accumulate with the distance. Cameras and points in between
/// move by what is between the two ends of their street. Then there is the noise of each by itself.
///
/// Synthetic, and no copy of a city: after the description of the problems in Konolige & Brown,
/// "Multigrid for Bundle Adjustment", arXiv 2007.01941, and of their generator City2BA.
///
/// Deterministic as GenerateStreetScene. Failure: kInvalidArgument if the options do not
/// Validate(), or ask for more than the cameras see; `*scene` is then unchanged. Threads: no shared
/// state.
Status GenerateCity(const CityOptions& options, const SceneProgress& progress, SimulatedBal* scene);

/// The preset "city-N": N cameras, 20 points each. kInvalidArgument unless N is a number in range.
Status GetCityPreset(const std::string& name, CityOptions* options);

}  // namespace inceres
