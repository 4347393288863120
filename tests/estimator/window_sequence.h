#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

#include <Eigen/Core>
#include <gtest/gtest.h>

#include "inceres/estimator/sliding_window_estimator.h"
#include "inceres/io/vio_sequence.h"
#include "inceres/problem/manifolds.h"
#include "support/random_values.h"
#include "tools/sim/vio_scene.h"

namespace inceres::test {

/// What a window is told of a sequence's camera and IMU.
inline SlidingWindowOptions WindowOptionsOf(const VioSequence& sequence) {
  SlidingWindowOptions options;
  options.body_from_camera = sequence.camera.imu_from_camera;
  options.feature_sigma = {sequence.pixel_noise / sequence.camera.intrinsics[0],
                           sequence.pixel_noise / sequence.camera.intrinsics[1]};
  options.imu.noise = sequence.imu_noise;
  std::copy(sequence.gravity.begin(), sequence.gravity.end(), options.imu.conventions.gravity);
  return options;
}

/// Frame i, its features without distortion.
inline WindowFrame WindowFrameOf(const VioSequence& sequence, std::size_t i) {
  WindowFrame frame;
  frame.time = sequence.frames[i].time;
  frame.imu = sequence.frames[i].imu;
  for (const VioObservation& seen : sequence.frames[i].observations) {
    const double pixel[2] = {seen.x, seen.y};
    std::array<double, 2> point{};
    if (sequence.camera.Pinhole().Unproject(pixel, point.data())) {
      frame.observations.push_back({seen.point, point});
    }
  }
  return frame;
}

inline WindowState TrueState(const VioFrame& frame) {
  return {frame.time, frame.truth.pose, frame.truth.velocity, frame.truth.gyr_bias,
          frame.truth.acc_bias};
}

/// The true first state, off by errors with the start's own standard deviations, so that it is as
/// well known as it says.
inline WindowStart DrawnStart(const VioSequence& sequence, Random* random, WindowStart start = {}) {
  start.state = TrueState(sequence.frames.front());
  double delta[6];
  for (std::size_t k = 0; k < 6; ++k) {
    delta[k] = start.pose_sigma[k] * random->Gaussian();
  }
  std::array<double, 7> pose{};
  static_cast<void>(PoseManifold().Plus(start.state.pose.data(), delta, pose.data()));
  start.state.pose = pose;
  for (std::size_t k = 0; k < 3; ++k) {
    start.state.velocity[k] += start.velocity_sigma[k] * random->Gaussian();
    start.state.gyr_bias[k] += start.gyr_bias_sigma[k] * random->Gaussian();
    start.state.acc_bias[k] += start.acc_bias_sigma[k] * random->Gaussian();
  }
  return start;
}

/// estimate ⊟ truth in the tangent of PoseManifold.
inline Eigen::Matrix<double, 6, 1> PoseError(const std::array<double, 7>& estimate,
                                             const std::array<double, 7>& truth) {
  Eigen::Matrix<double, 6, 1> error;
  static_cast<void>(PoseManifold().Minus(estimate.data(), truth.data(), error.data()));
  return error;
}

/// The scene of a preset, or the default one, shortened.
inline VioSequence Simulate(const std::string& preset, int num_frames, std::uint64_t seed = 1) {
  VioSceneOptions scene;
  if (!preset.empty()) {
    EXPECT_TRUE(GetVioScenePreset(preset, &scene).ok());
  }
  scene.num_frames = num_frames;
  scene.seed = seed;
  VioSequence sequence;
  const Status status = GenerateVioScene(scene, &sequence);
  EXPECT_TRUE(status.ok()) << status.message;
  return sequence;
}

/// A start that is known well, as after an initialization.
inline WindowStart GoodStart() {
  WindowStart start;
  start.pose_sigma = {1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3};
  start.velocity_sigma = {0.01, 0.01, 0.01};
  start.gyr_bias_sigma = {1e-3, 1e-3, 1e-3};
  start.acc_bias_sigma = {0.01, 0.01, 0.01};
  return start;
}

/// A window on a sequence from a good start.
struct WindowRun {
  WindowRun(const VioSequence& played, const SlidingWindowOptions& options, unsigned seed = 7)
      : sequence(played), estimator(options) {
    Random random(seed);
    const Status status = estimator.Start(DrawnStart(sequence, &random, GoodStart()),
                                          WindowFrameOf(sequence, 0).observations);
    EXPECT_TRUE(status.ok()) << status.message;
  }

  /// The next frame.
  const WindowSummary& Step() {
    estimator.AddFrame(WindowFrameOf(sequence, next), &summary);
    EXPECT_TRUE(summary.status.ok()) << "frame " << next << ": " << summary.status.message;
    const auto error = PoseError(summary.state.pose, sequence.frames[next].truth.pose);
    sum_of_squares += error.head<3>().squaredNorm();
    ++next;
    return summary;
  }
  void Play(std::size_t end) {
    while (next < end && next < sequence.frames.size()) {
      Step();
    }
  }
  /// Of the newest positions so far, to the truth, meters.
  double RmsError() const { return std::sqrt(sum_of_squares / static_cast<double>(next - 1)); }

  const VioSequence& sequence;
  SlidingWindowEstimator estimator;
  WindowSummary summary;
  std::size_t next = 1;
  double sum_of_squares = 0.0;
};

}  // namespace inceres::test
