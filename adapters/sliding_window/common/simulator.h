#pragma once

#include <cstdint>
#include <random>
#include <vector>

#include "common/frame.h"
#include "common/imu_preintegration.h"

namespace sliding_window {

struct SimulatorOptions {
  std::uint64_t seed = 1;
  int tracks_per_frame = 70;  // features that an image shows
  int min_track_length = 3;   // frames; a feature is lost after a random number of them, or when it leaves the image
  int max_track_length = 13;
  double pixel_noise = 0.7;  // standard deviation, pixels
  ImuNoise imu_noise;
};

/// A drone that flies rounds through a hall, with a camera (10 Hz) that looks ahead and an IMU (200 Hz). Its path is closed-form,
/// so that the truth is exact; noise is drawn from the seed. Features are made where the camera looks, at random depths, and last
/// for a random number of frames.
class Simulator {
 public:
  static constexpr double kFocalLength = 460.0;  // pixels
  static constexpr double kHalfWidth = 320.0, kHalfHeight = 240.0;
  static constexpr int kImuSamplesPerFrame = 20;
  static constexpr double kImuPeriod = 0.005;  // s

  explicit Simulator(const SimulatorOptions& options);

  /// The next image and the IMU samples since the last one.
  Frame Next();

  /// The true state at a time; the biases are those of the last sample made.
  ImuState Truth(double time) const;
  /// Body from camera: the camera looks along the body's x axis, its own z.
  static Pose TrueExtrinsic();

 private:
  struct Track {
    int feature;
    int frames_left;
    Eigen::Vector3d point;
  };

  ImuSample NextImuSample();
  void Observe(Frame* frame);
  Track NewTrack(const Pose& world_from_camera);
  Eigen::Vector3d Noise(double standard_deviation);

  SimulatorOptions options_;
  std::mt19937_64 random_;
  int next_frame_ = 0;
  int next_imu_sample_ = 0;
  int next_feature_ = 0;
  ImuSample last_imu_sample_;
  Eigen::Vector3d ba_, bg_;
  std::vector<Track> tracks_;
};

}  // namespace sliding_window
