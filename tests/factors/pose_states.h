#pragma once

#include <algorithm>
#include <vector>

#include "factors/numeric_jacobian.h"
#include "inceres/factors/body_reprojection.h"
#include "inceres/factors/pose_prior.h"
#include "inceres/factors/relative_pose.h"
#include "inceres/problem/manifolds.h"
#include "inceres/problem/rotation.h"

namespace inceres::test {

inline const PoseManifold kPoseManifold;

/// A measurement and a state of an inverse-depth reprojection; parameters: pose a, pose b, inverse
/// depth.
struct ReprojectionState {
  InverseDepthReprojectionFamily::Measurement measurement;
  FactorState state;
};

/// A thousand of them: any rotations, equal poses' rotations, depths down to infinity, the feature
/// well in front of b's plane or behind it.
inline std::vector<ReprojectionState> ThousandReprojectionStates() {
  Random random(31);
  std::vector<ReprojectionState> states;
  while (states.size() < 1000) {
    ReprojectionState s;
    std::vector<double> a(7), b(7);
    for (std::size_t k = 0; k < 3; ++k) {
      a[k] = random.Unit();
      b[k] = random.Unit();
    }
    RandomRotation(random, random.Between(0.0, 3.1), a.data() + 3);
    double turn[4];
    const int kind = static_cast<int>(states.size() % 4);
    RandomRotation(random, kind == 0 ? 0.0 : kind == 1 ? 1e-9 : random.Between(0.0, 1.2), turn);
    MultiplyQuaternions(a.data() + 3, turn, b.data() + 3);
    const double d = states.size() % 10 == 0 ? 0.0 : random.Between(-0.05, 2.0);
    s.measurement.anchor_point[0] = 0.6 * random.Unit();
    s.measurement.anchor_point[1] = 0.6 * random.Unit();
    s.measurement.observed_point[0] = 0.6 * random.Unit();
    s.measurement.observed_point[1] = 0.6 * random.Unit();
    s.measurement.sqrt_information[0] = random.Between(100.0, 600.0);
    s.measurement.sqrt_information[1] = random.Between(-100.0, 100.0);
    s.measurement.sqrt_information[2] = random.Between(100.0, 600.0);
    // The depth in b: away from its plane, where the projection is not smooth.
    double R_a[9], R_b[9], world[3];
    const double m[3] = {s.measurement.anchor_point[0], s.measurement.anchor_point[1], 1.0};
    QuaternionToMatrix(a.data() + 3, R_a);
    QuaternionToMatrix(b.data() + 3, R_b);
    MultiplyMatrixVector(R_a, m, world);
    double depth = 0.0;
    for (int k = 0; k < 3; ++k) {
      const auto i = static_cast<std::size_t>(k);
      depth += R_b[3 * k + 2] * (world[k] + d * (a[i] - b[i]));
    }
    if (depth > 0.5 || (depth < -0.5 && states.size() % 3 == 0)) {
      s.state = {{a, b, {d}}, {&kPoseManifold, &kPoseManifold, nullptr}};
      states.push_back(s);
    }
  }
  return states;
}

/// A measurement and a state of a relative pose; parameters: pose a, pose b.
struct RelativePoseState {
  RelativePoseFamily::Measurement measurement;
  FactorState state;
  double angle = 0.0;  ///< of the rotation residual
};

/// A thousand of them, rotation residuals from exactly 0 to nearly π.
inline std::vector<RelativePoseState> ThousandRelativePoseStates() {
  Random random(32);
  const double angles[8] = {0.0, 1e-300, 1e-160, 1e-12, 1e-5, 0.0999, 0.1001, 3.1};
  std::vector<RelativePoseState> states;
  for (int i = 0; i < 1000; ++i) {
    RelativePoseState s;
    s.angle = i % 2 == 0 ? angles[(i / 2) % 8] : random.Between(0.0, 3.0);
    std::vector<double> a(7), b(7);
    for (std::size_t k = 0; k < 3; ++k) {
      a[k] = 3.0 * random.Unit();
      b[k] = 3.0 * random.Unit();
      s.measurement.p_ab[k] = 3.0 * random.Unit();
    }
    RandomRotation(random, random.Between(0.0, 3.1), a.data() + 3);
    RandomRotation(random, random.Between(0.0, 3.1), s.measurement.q_ab);
    // R_b = R_a Exp(error) R_ab
    double error[4], turned[4];
    RandomRotation(random, s.angle, error);
    MultiplyQuaternions(a.data() + 3, error, turned);
    MultiplyQuaternions(turned, s.measurement.q_ab, b.data() + 3);
    double G[36], information[36];
    for (double& g : G) {
      g = random.Unit();
    }
    for (int r = 0; r < 6; ++r) {
      for (int c = 0; c < 6; ++c) {
        information[6 * r + c] = r == c ? 1.0 : 0.0;
        for (int k = 0; k < 6; ++k) {
          information[6 * r + c] += 10.0 * G[6 * k + r] * G[6 * k + c];
        }
      }
    }
    EXPECT_TRUE(SqrtInformation(information, 6, s.measurement.sqrt_information));
    s.state = {{a, b}, {&kPoseManifold, &kPoseManifold}};
    states.push_back(s);
  }
  return states;
}

}  // namespace inceres::test
