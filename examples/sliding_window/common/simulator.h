#pragma once

#include <cstdint>
#include <random>
#include <vector>

#include "common/frame.h"
#include "common/imu_preintegration.h"

namespace sliding_window {

/// How the drone flies.
struct Flight {
  double latest_start =
      0.0;            // s; how late on its path the run may begin: when is drawn from the seed
  double size = 1.0;  // 1: rounds of 12 m by 8 m
  double round_rate = 0.3;  // rad/s
  double sway = 1.0;        // of the attitude; 1: 0.25 rad in yaw, 0.12 in pitch, 0.15 in roll
};

struct SimulatorOptions {
  std::uint64_t seed = 1;
  int num_cameras = 1;        // 2: another beside the first
  double min_depth = 1.5;     // m, of new features
  double max_depth = 12.0;    // m
  int tracks_per_frame = 70;  // features that an image shows
  // frames; a feature is lost after a random number of them, or when it leaves the image
  int min_track_length = 3;
  int max_track_length = 13;
  double pixel_noise = 0.7;    // standard deviation, pixels
  double outlier_share = 0.0;  // of the observations, whose noise is kOutlierFactor as large
  // standard deviation of the guessed depths, as a share of them; 0: none are guessed
  double depth_error = 0.0;
  double acc_bias = 0.05;   // m/s^2, standard deviation of the first
  double gyr_bias = 0.005;  // rad/s
  ImuNoise imu_noise;
  Flight flight;
};

/// A drone that flies rounds through a hall, with one camera or two (10 Hz) that look ahead and an
/// IMU (200 Hz). Its path is closed-form, so that the truth is exact; noise is drawn from the seed.
/// Features are made where the camera looks, at random depths, and last for a random number of
/// frames.
class Simulator {
 public:
  static constexpr double kFocalLength = 460.0;  // pixels
  static constexpr double kHalfWidth = 320.0, kHalfHeight = 240.0;
  static constexpr int kImuSamplesPerFrame = 20;
  static constexpr double kImuPeriod = 0.005;  // s
  static constexpr double kOutlierFactor = 15.0;

  explicit Simulator(const SimulatorOptions& options);

  /// The next image and the IMU samples since the last one.
  Frame Next();

  /// The true state at a time; the biases are those of the last sample made.
  ImuState Truth(double time) const;
  /// What an accelerometer without noise reads at a time: gravity and the drone's acceleration,
  /// with the bias of the last sample.
  Eigen::Vector3d SpecificForce(double time) const;
  /// Body from each camera: a camera looks along the body's x axis, its own z.
  std::vector<Pose> TrueExtrinsics() const;

 private:
  struct Track {
    int feature;
    int frames_left;
    Eigen::Vector3d point;
  };

  ImuSample NextImuSample();
  void Observe(Frame* frame);
  void ObserveTrack(const Track& track, int camera, const Pose& camera_from_world, Frame* frame);
  Eigen::Vector3d PixelNoise();
  Track NewTrack(const Pose& world_from_camera);
  Eigen::Vector3d Noise(double standard_deviation);

  SimulatorOptions options_;
  double start_ = 0.0;  // s, of the run on the path
  std::mt19937_64 random_;
  int next_frame_ = 0;
  int next_imu_sample_ = 0;
  int next_feature_ = 0;
  ImuSample last_imu_sample_;
  Eigen::Vector3d ba_, bg_;
  std::vector<Track> tracks_;
};

}  // namespace sliding_window
