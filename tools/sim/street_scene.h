#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "inceres/io/bal.h"
#include "inceres/status.h"
#include "tools/sim/bal_noise.h"

namespace inceres {

/// What a simulated street looks like and how it is seen. Lengths in meters, angles in radians,
/// image quantities in pixels.
///
/// The three sizes come out exactly, unless num_observations is 0.
struct StreetSceneOptions : BalNoise {
  int num_cameras = 100;   ///< 2 .. 1,000,000
  int num_points = 10000;  ///< at least 1
  /// at least two per point; at most what the street lets the cameras see; or 0: see track_length
  int num_observations = 50000;
  /// If num_observations is 0: the mean of the track lengths that are drawn, 2 .. 1000. A point
  /// that fewer cameras see has a shorter track. No round over the points makes the number exact,
  /// so that the start of the street is like its end.
  double track_length = 4.0;

  /// Rounds of a closed circuit. 0: an open, gently winding street. 1: the end comes back to the
  /// start. 2.5: every place is passed two or three times.
  double laps = 0.0;
  /// Share of the points that are recognized when the camera comes by again, 0 .. 1. Without effect
  /// if no place is revisited.
  double loop_fraction = 0.3;
  /// Share of the circuit, from its start, along which points can be recognized, 0 .. 1: below 1
  /// there is a loop to close once a lap, with stretches in between where nothing is seen again.
  double loop_stretch = 1.0;
  /// Distance between consecutive cameras, at most 10. 0: chosen so that points have the tracks
  /// that the three sizes ask for.
  double camera_spacing = 0.0;

  std::uint64_t seed = 1;

  /// Mean number of observations of a point, as asked for.
  double MeanTrackLength() const;
  /// Ok, or kInvalidArgument naming the field, its value and the range.
  Status Validate() const;
};

/// A generated problem and what is behind it. Both problems have the same observations in the same
/// order, sorted by point, then by camera.
struct StreetScene {
  BalProblem problem;  ///< noisy observations, start values = truth + noise
  /// exact projections, true cameras and points: its reprojection error is rounding
  BalProblem truth;
  std::vector<int> outliers;  ///< indices of the observations that are outliers, ascending
};

/// Sets `*options` to a preset; kInvalidArgument listing the known names if there is none of this
/// name (options unchanged). They are, in the order of the documentation, "ladybug-like" (49
/// cameras, 7,776 points, 31,843 observations), "venice11" (11, 8,366, 20,271), "cathedral" (92,
/// 57,957, 422,163), and paths with loops that are closed along a tenth of the way: "path-400"
/// (400, 16,000, 80,000), "path-1800" (1,800, 72,000, 360,000), "path-1000" (1,000, 40,000,
/// 200,000) and "path-10000" (10,000, 400,000, 2,000,000).
Status GetStreetScenePreset(const std::string& name, StreetSceneOptions* options);

/// Simulates a camera that moves through a street of points: facades on both sides and the ground
/// between them. Each camera sees only what is near and inside its image; each point is seen by at
/// least two cameras from directions at least two degrees apart, at a depth of at least two meters,
/// and every camera sees points of its own. The result is a well-conditioned BAL problem from whose
/// start values Levenberg-Marquardt converges.
///
/// Deterministic: the same options give the same bits on every platform with IEEE arithmetic (own
/// distributions and elementary functions over std::mt19937_64). Linear in the number of points and
/// observations.
///
/// Failure: kInvalidArgument if the options do not Validate(), or if they ask for more observations
/// than the street allows, or for a problem with fewer equations than unknowns; `*scene` is then
/// unchanged. Threads: no shared state.
Status GenerateStreetScene(const StreetSceneOptions& options, StreetScene* scene);

}  // namespace inceres
