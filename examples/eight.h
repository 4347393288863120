#pragma once

#include <array>
#include <cmath>
#include <cstdint>

#include "examples/noise.h"
#include "inceres/problem/rotation.h"

/// A track in the shape of an eight, 40 m long and with a hill, that a robot drives along, 60 poses
/// a lap. Whatever is asked for has the same answer each time.
namespace eight {

using Pose = std::array<double, 7>;  // p, q (x, y, z, w)
constexpr int kLap = 60;
constexpr double kSigmaPosition = 0.05;                 // meters
constexpr double kSigmaTurn[3] = {0.005, 0.005, 0.02};  // rad: roll, pitch, yaw

/// The pose that a motion leads to.
inline Pose After(const Pose& start, const Pose& motion) {
  Pose pose;
  inceres::ComposePoses(start.data(), motion.data(), pose.data());
  return pose;
}

/// The motion from one pose to another: b as seen from a.
inline Pose Between(const Pose& a, const Pose& b) {
  Pose inverse;
  inceres::InvertPose(a.data(), inverse.data());
  return After(inverse, b);
}

inline Pose TruePose(int i) {
  const double s = 2.0 * M_PI * i / kLap;
  const double turn[3] = {0.0, 0.0, std::atan2(20.0 * std::cos(2.0 * s), 20.0 * std::cos(s))};
  Pose pose = {20.0 * std::sin(s), 10.0 * std::sin(2.0 * s), 2.0 * std::sin(s)};
  inceres::ExpQuaternion(turn, &pose[3]);
  return pose;
}

/// How pose b was seen from pose a, beside the truth by the sigmas above.
inline Pose Measure(int a, int b) {
  Noise noise(static_cast<std::uint32_t>(1000 * a + b));
  Pose error = {noise.Normal(kSigmaPosition), noise.Normal(kSigmaPosition),
                noise.Normal(kSigmaPosition)};
  const double turn[3] = {noise.Normal(kSigmaTurn[0]), noise.Normal(kSigmaTurn[1]),
                          noise.Normal(kSigmaTurn[2])};
  inceres::ExpQuaternion(turn, &error[3]);
  return After(Between(TruePose(a), TruePose(b)), error);
}

}  // namespace eight
