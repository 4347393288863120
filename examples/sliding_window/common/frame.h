#pragma once

#include <vector>

#include <Eigen/Core>

#include "common/pose.h"

namespace sliding_window {

/// What the sensors deliver with one image, and the states that are estimated from it.
struct ImuSample {
  double time = 0.0;    // s
  Eigen::Vector3d acc;  // m/s^2, body axes; +g upward at rest
  Eigen::Vector3d gyr;  // rad/s, body axes
};

struct Observation {
  int feature = 0;     // the same number in every frame that sees it
  Eigen::Vector2d xy;  // on the image plane at depth 1
  int camera = 0;
  double depth = 0.0;  // m, as a front end guesses it; 0: it does not
};

struct Frame {
  double time = 0.0;
  // from the previous frame's time to this one's, both included; empty for the first frame
  std::vector<ImuSample> imu;
  std::vector<Observation> observations;
};

/// Position, attitude (world from body), velocity (world axes) and IMU biases.
struct ImuState {
  Pose pose;
  Eigen::Vector3d v = Eigen::Vector3d::Zero();
  Eigen::Vector3d ba = Eigen::Vector3d::Zero();
  Eigen::Vector3d bg = Eigen::Vector3d::Zero();
};

/// The world's z axis points up: an accelerometer at rest reads q^-1 kGravity.
inline const Eigen::Vector3d kGravity(0.0, 0.0, 9.81);  // NOLINT(cert-err58-cpp)

}  // namespace sliding_window
