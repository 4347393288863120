#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "inceres/io/vio_sequence.h"
#include "inceres/status.h"
#include "tools/sim/trajectory.h"

namespace inceres {

/// A simulated camera with an IMU: how it moves, what it sees, and what is wrong with its
/// measurements. Meters, seconds, radians, pixels. Noise knobs are standard deviations; 0 switches
/// a noise off.
struct VioSceneOptions {
  TrajectoryOptions trajectory;
  int num_frames = 100;      ///< 2 .. 1,000,000
  double frame_rate = 10.0;  ///< per second, 0.01 .. 1000
  int imu_per_frame = 20;    ///< IMU samples from one frame to the next, 1 .. 10,000
  VioCamera camera;

  int num_points = 500;         ///< 1 .. 10,000,000
  int num_observations = 0;     ///< exactly, at least two per point; 0: all that is seen
  int max_track_length = 1000;  ///< how often a point is seen at most, 2 .. 1,000,000
  double min_depth = 1.0;       ///< points are seen from here …
  double max_depth = 12.0;      ///< … to here, along the camera's axis; 0.01 .. 1e6
  /// Some two frames see a point from directions at least this different, in radians, 0 .. 1. So a
  /// turn on the spot shows no points but those that are seen from elsewhere.
  double min_parallax = 0.03;
  /// share of the points that are recognized when they come into view again, 0 .. 1
  double loop_fraction = 0.3;
  double dropout = 0.0;  ///< share of the sightings in which a feature is not detected, 0 .. 0.95

  double pixel_noise = 1.0;  ///< on each image coordinate
  /// share of the observations that are wrong, 0 .. 1; the number is rounded to the nearest
  double outlier_fraction = 0.0;
  /// outliers are displaced by up to this much in x and in y, uniformly
  double outlier_pixels = 50.0;

  double gyr_noise = 1.7e-4;       ///< density, rad/s/√Hz
  double acc_noise = 2e-3;         ///< density, m/s²/√Hz
  double gyr_bias_walk = 2e-5;     ///< density, rad/s²/√Hz
  double acc_bias_walk = 3e-3;     ///< density, m/s³/√Hz
  double initial_gyr_bias = 0.01;  ///< of each coordinate of the first bias, rad/s
  double initial_acc_bias = 0.05;  ///< m/s²

  /// Start values drift from the truth as an odometry's do: slowly, by sines with periods around 20
  /// s, from nothing at the first frame to about this much; the start velocity is that of the
  /// drifting place, and start biases are 0.
  double position_drift = 0.05;
  double rotation_drift = 0.005;  ///< about the axes of the world
  double point_noise = 0.1;       ///< start values: each coordinate of a point, independently

  std::uint64_t seed = 1;

  /// Ok, or kInvalidArgument naming the field, its value and the range.
  Status Validate() const;
};

/// "cubic" (circle; 50 frames, 163 points, 789 observations, 49 stretches of IMU samples: the size
/// of a problem the literature reports on), "figure_eight" (a minute, three rounds: loops to
/// close), "ellipse" (a minute of the scene of the literature's data generators, with stops to turn
/// on the spot).
std::vector<std::string> VioScenePresets();

/// Sets `*options` to a preset; kInvalidArgument listing the known names if there is none of this
/// name (options unchanged).
Status GetVioScenePreset(const std::string& name, VioSceneOptions* options);

/// Simulates the sequence: points are placed at random where some frame sees them, so that all
/// frames see about as many; a point is tracked as long as it stays in view, and, if it is one of
/// those that are recognized, again later. Observations are projections of the true points at the
/// true poses plus noise; IMU samples are the closed-form rates plus a bias that walks plus white
/// noise. The sequence's noise densities are those of the options, or the defaults of VioSequence
/// for a noise that is switched off: they are weights. Points are numbered in the order in which
/// they come into view.
///
/// Deterministic: the same options give the same bits on every platform with IEEE arithmetic, and
/// switching one noise off leaves everything else as it was.
///
/// Failure: kInvalidArgument if the options do not Validate(), or if the frames do not see so many
/// points, or so often; `*sequence` is then unchanged. Cost: a point that is recognized is looked
/// for in all frames. Threads: no shared state.
Status GenerateVioScene(const VioSceneOptions& options, VioSequence* sequence);

}  // namespace inceres
