#pragma once

#include <cmath>
#include <cstddef>
#include <random>

#include "inceres/io/keyframes.h"
#include "inceres/problem/rotation.h"

namespace inceres::tools {

/// Keyframes on a circle that look inwards at points on a smaller one, which each keyframe anchors
/// six new ones of and the next three see again; relative poses of neighbors and of the last with
/// the first. Observations with a little noise, perturbed start values.
inline KeyframeSequence SmallKeyframes(int count) {
  std::mt19937 random(17);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  KeyframeSequence sequence;
  std::vector<std::array<double, 7>> truth;
  std::vector<std::array<double, 3>> points;  // of the features, in the world
  const auto into_camera = [](const std::array<double, 7>& pose, const double* X, double* P) {
    double R[9];
    QuaternionToMatrix(pose.data() + 3, R);
    for (std::size_t c = 0; c < 3; ++c) {
      P[c] = 0.0;
      for (std::size_t r = 0; r < 3; ++r) {
        P[c] += R[3 * r + c] * (X[r] - pose[r]);
      }
    }
  };
  for (int i = 0; i < count; ++i) {
    const double angle = 0.1 * i;
    // Turned by −angle about y, from 4 m out the camera looks at the middle.
    const double turn[3] = {0.0, -angle, 0.0};
    std::array<double, 7> pose{
        4.0 * std::sin(angle), 0.0, -4.0 * std::cos(angle), 0.0, 0.0, 0.0, 1.0};
    ExpQuaternion(turn, pose.data() + 3);
    truth.push_back(pose);
    Keyframe keyframe;
    keyframe.pose = pose;
    if (i > 0) {
      for (std::size_t k = 0; k < 3; ++k) {
        keyframe.pose[k] += 0.02 * uniform(random);
      }
    }
    double P[3];
    for (int f = std::max(0, 6 * (i - 3)); f < 6 * i; ++f) {
      into_camera(pose, points[static_cast<std::size_t>(f)].data(), P);
      keyframe.observations.push_back({f,
                                       P[0] / P[2] + 1e-3 * uniform(random),
                                       P[1] / P[2] + 1e-3 * uniform(random),
                                       0.0,
                                       {2e5, 1e3, 2.5e5}});
      if (f >= 6 * (i - 1) && f % 3 != 0) {
        keyframe.depth_guesses.push_back({f, 0.3});
      }
    }
    for (int k = 0; k < 6; ++k) {
      const std::array<double, 3> X{uniform(random), uniform(random), uniform(random)};
      into_camera(pose, X.data(), P);
      keyframe.features.push_back(static_cast<int>(points.size()));
      sequence.features.push_back(
          {i, k, P[0] / P[2], P[1] / P[2], k % 2 == 0 ? 1.0 / P[2] + 0.01 * uniform(random) : 0.0});
      points.push_back(X);
    }
    for (const int a : {i - 1, 0}) {
      if (i == 0 || (a == 0 && (i < 2 || i + 1 < count))) {
        continue;
      }
      KeyframeBetween between;
      between.a = a;
      between.b = i;
      const std::array<double, 7>& pose_a = truth[static_cast<std::size_t>(a)];
      const double q_a_inverse[4] = {-pose_a[3], -pose_a[4], -pose_a[5], pose_a[6]};
      MultiplyQuaternions(q_a_inverse, pose.data() + 3, between.q_ab.data());
      into_camera(pose, pose_a.data(), between.p_ab.data());
      for (std::size_t k = 0; k < 6; ++k) {
        between.information[7 * k] = k < 3 ? 3000.0 : 100.0;
      }
      keyframe.betweens.push_back(between);
    }
    sequence.keyframes.push_back(keyframe);
  }
  return sequence;
}

}  // namespace inceres::tools
