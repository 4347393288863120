// Reprojection between two poses of a body with a camera on it: against the same through camera
// poses, and numeric Jacobians.
#include "inceres/factors/body_reprojection.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include <gtest/gtest.h>

#include "factors/pose_states.h"

namespace inceres {
namespace {

using test::EvaluateFactor;
using test::FactorState;
using test::FactorValues;
using TimeOffset = BodyReprojectionFamily::TimeOffset;

// body = world_from_camera ∘ camera_from_body, so that the camera stands where the state wants it.
std::vector<double> BodyOf(const std::vector<double>& camera, const std::vector<double>& on_body) {
  std::vector<double> body(7);
  double back[4], R[9], turned[3];
  ConjugateQuaternion(on_body.data() + 3, back);
  MultiplyQuaternions(camera.data() + 3, back, body.data() + 3);
  QuaternionToMatrix(body.data() + 3, R);
  MultiplyMatrixVector(R, on_body.data(), turned);
  for (std::size_t k = 0; k < 3; ++k) {
    body[k] = camera[k] - turned[k];
  }
  return body;
}

// The reprojection states of pose_states.h, seen from a body whose camera sits at `on_body`, with
// the features moved on.
struct BodyState {
  BodyReprojectionFamily::Measurement measurement;
  FactorState state;
};

BodyState OnBody(test::Random& random, const test::ReprojectionState& s, bool with_offset) {
  std::vector<double> on_body = random.Vector(7);
  test::RandomRotation(random, random.Between(0.0, 3.1), on_body.data() + 3);
  BodyState body;
  body.measurement.offset_i = random.Unit();
  body.measurement.offset_j = random.Unit();
  const double tau = random.Unit();
  for (int k = 0; k < 2; ++k) {
    body.measurement.velocity_i[k] = 0.3 * random.Unit();
    body.measurement.velocity_j[k] = 0.3 * random.Unit();
    // So that at τ they are where the plain state has them.
    const double move_i =
        with_offset ? (tau - body.measurement.offset_i) * body.measurement.velocity_i[k] : 0.0;
    const double move_j =
        with_offset ? (tau - body.measurement.offset_j) * body.measurement.velocity_j[k] : 0.0;
    body.measurement.point_i[k] = s.measurement.anchor_point[k] + move_i;
    body.measurement.point_j[k] = s.measurement.observed_point[k] + move_j;
  }
  std::copy_n(s.measurement.sqrt_information, 3, body.measurement.sqrt_information);
  const auto& x = s.state.parameters;
  const Manifold* pose = &test::kPoseManifold;
  body.state = {{BodyOf(x[0], on_body), BodyOf(x[1], on_body), on_body, x[2]},
                {pose, pose, pose, nullptr}};
  if (with_offset) {
    body.state.parameters.push_back({tau});
    body.state.manifolds.push_back(nullptr);
  }
  return body;
}

TEST(BodyReprojection, IsTheCamerasReprojectionAndJacobiansAreNumericOnes) {
  test::Random random(61);
  int index = 0;
  for (const test::ReprojectionState& s : test::ThousandReprojectionStates()) {
    const bool with_offset = index % 2 == 0;
    const BodyState body = OnBody(random, s, with_offset);
    BodyReprojectionFamily family(with_offset ? TimeOffset::kEstimated : TimeOffset::kNone);
    family.Add(body.measurement);
    InverseDepthReprojectionFamily cameras;
    cameras.Add(s.measurement);
    const FactorValues expected = EvaluateFactor(cameras, s.state);
    const FactorValues values = EvaluateFactor(family, body.state);
    ASSERT_FALSE(values.failure.failed()) << values.failure.reason;
    for (std::size_t r = 0; r < 2; ++r) {
      EXPECT_NEAR(values.residuals[r], expected.residuals[r],
                  1e-11 * (1.0 + std::fabs(expected.residuals[r])))
          << index;
    }
    // A feature at infinity, seen twice in one direction, says nothing about where the camera sits:
    // differences leave rounding.
    const bool at_infinity = s.state.parameters[2][0] == 0.0;
    test::ExpectNumericJacobians(family, body.state, at_infinity ? 1e-6 : 1e-8, index++);
  }
}

TEST(BodyReprojection, ABearingThatIsEstimatedIsTheSameFunctionOfOneVariableMore) {
  test::Random random(62);
  int index = 0;
  for (const test::ReprojectionState& s : test::ThousandReprojectionStates()) {
    const bool with_offset = index % 2 == 0;
    BodyState body = OnBody(random, s, with_offset);
    const TimeOffset offset = with_offset ? TimeOffset::kEstimated : TimeOffset::kNone;
    BodyReprojectionFamily exact(offset),
        bearing(offset, BodyReprojectionFamily::Feature::kBearing);
    exact.Add(body.measurement);
    const FactorValues expected = EvaluateFactor(exact, body.state);
    const double* m = body.measurement.point_i;
    body.state.parameters[3] = {m[0], m[1], body.state.parameters[3][0]};
    body.measurement.point_i[0] = body.measurement.point_i[1] = 1e3;  // not looked at
    bearing.Add(body.measurement);
    const FactorValues values = EvaluateFactor(bearing, body.state);
    EXPECT_EQ(values.residuals, expected.residuals);
    EXPECT_EQ(values.jacobians[0], expected.jacobians[0]);
    for (std::size_t r = 0; r < 2; ++r) {
      EXPECT_EQ(values.jacobians[3][3 * r + 2], expected.jacobians[3][r]);
    }
    test::ExpectNumericJacobians(bearing, body.state, 1e-6, index++);
  }
}

TEST(BodyReprojection, FailsInTheCamerasPlaneAndOnNonFiniteValues) {
  BodyReprojectionFamily family;
  family.Add({});
  const std::vector<double> origin{0, 0, 0, 0, 0, 0, 1};
  const Manifold* pose = &test::kPoseManifold;
  FactorState state{{origin, {0, 0, 2, 0, 0, 0, 1}, origin, {0.5}}, {pose, pose, pose, nullptr}};
  EXPECT_STREQ(EvaluateFactor(family, state).failure.reason,
               "the feature lies in the observing camera's plane (depth 0)");
  state.parameters[2][0] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_STREQ(EvaluateFactor(family, state).failure.reason, "a residual is not finite");
  EXPECT_EQ(EvaluateFactor(family, state).failure.factor, 0);
}

}  // namespace
}  // namespace inceres
