// Inverse depth by two cameras, between two poses or at one, and on the unit sphere: against points
// that are moved the long way round, and numeric Jacobians.
#include <cmath>
#include <vector>

#include <gtest/gtest.h>

#include "factors/visual_states.h"
#include "inceres/factors/body_reprojection.h"

namespace inceres {
namespace {

using test::EvaluateFactor;
using test::FactorValues;
using test::Real;
using test::Vector3;
using Error = BodyReprojectionFamily::Error;
using Feature = BodyReprojectionFamily::Feature;
using TimeOffset = BodyReprojectionFamily::TimeOffset;
using Views = BodyReprojectionFamily::Views;

const PoseManifold kPose;

struct ViewState {
  BodyReprojectionFamily::Measurement measurement;
  test::FactorState state;
  Vector3 in_camera_j;
  double tau;
};

// Random frames and a feature whose depth in camera j is not too small.
ViewState RandomView(test::Random& random, Views views, TimeOffset offset) {
  ViewState s;
  auto& m = s.measurement;
  do {
    s.tau = offset == TimeOffset::kEstimated ? random.Unit() : 0.0;
    for (int k = 0; k < 2; ++k) {
      m.point_i[k] = 0.6 * random.Unit();
      m.point_j[k] = 0.6 * random.Unit();
      m.velocity_i[k] = 0.3 * random.Unit();
      m.velocity_j[k] = 0.3 * random.Unit();
    }
    m.offset_i = offset == TimeOffset::kEstimated ? random.Unit() : 0.0;
    m.offset_j = offset == TimeOffset::kEstimated ? random.Unit() : 0.0;
    m.sqrt_information[0] = random.Between(100.0, 600.0);
    m.sqrt_information[1] = random.Between(-100.0, 100.0);
    m.sqrt_information[2] = random.Between(100.0, 600.0);
    const double lambda = random.Between(0.1, 2.0);
    const std::vector<double> pose_i = test::RandomPose(random),
                              camera_i = test::RandomPose(random);
    const std::vector<double> pose_j =
        views == Views::kOnePoseTwoCameras ? pose_i : test::RandomPose(random);
    const std::vector<double> camera_j =
        views == Views::kTwoPoses ? camera_i : test::RandomPose(random);
    const Vector3 in_camera_i{(m.point_i[0] - (s.tau - m.offset_i) * m.velocity_i[0]) / lambda,
                              (m.point_i[1] - (s.tau - m.offset_i) * m.velocity_i[1]) / lambda,
                              1.0 / lambda};
    s.in_camera_j = test::Into(
        camera_j, test::Into(pose_j, test::OutOf(pose_i, test::OutOf(camera_i, in_camera_i))));
    s.state = {};
    if (views != Views::kOnePoseTwoCameras) {
      s.state.parameters = {pose_i, pose_j};
    }
    s.state.parameters.push_back(camera_i);
    if (views != Views::kTwoPoses) {
      s.state.parameters.push_back(camera_j);
    }
    s.state.manifolds.assign(s.state.parameters.size(), &kPose);
    s.state.parameters.push_back({lambda});
    if (offset == TimeOffset::kEstimated) {
      s.state.parameters.push_back({s.tau});
    }
    s.state.manifolds.resize(s.state.parameters.size(), nullptr);
    // λ times the depth is what the formula divides by.
    if (std::fabs(static_cast<double>(s.in_camera_j[2]) * lambda) > 0.5) {
      return s;
    }
  } while (true);
}

// On the plane: the residual itself. On the sphere, whose basis is the family's business: its
// length, unweighted, which is that of ĥ − d without its part along the direction of point_j.
void ExpectResidual(ViewState s, Views views, TimeOffset offset, Error error, int index) {
  Real z[2];
  for (int k = 0; k < 2; ++k) {
    z[k] =
        s.measurement.point_j[k] - (s.tau - s.measurement.offset_j) * s.measurement.velocity_j[k];
  }
  const double U[3] = {s.measurement.sqrt_information[0], s.measurement.sqrt_information[1],
                       s.measurement.sqrt_information[2]};
  if (error == Error::kUnitSphere) {
    const double identity[3] = {1.0, 0.0, 1.0};
    std::copy_n(identity, 3, s.measurement.sqrt_information);
  }
  BodyReprojectionFamily family(offset, Feature::kInverseDepth, views, error);
  family.Add(s.measurement);
  const FactorValues values = EvaluateFactor(family, s.state);
  ASSERT_FALSE(values.failure.failed()) << values.failure.reason;
  if (error == Error::kPlane) {
    const Real e[2] = {s.in_camera_j[0] / s.in_camera_j[2] - z[0],
                       s.in_camera_j[1] / s.in_camera_j[2] - z[1]};
    const double expected[2] = {static_cast<double>(U[0] * e[0] + U[1] * e[1]),
                                static_cast<double>(U[2] * e[1])};
    for (std::size_t r = 0; r < 2; ++r) {
      ASSERT_NEAR(values.residuals[r], expected[r], 1e-10 * (1.0 + std::fabs(expected[r])))
          << index;
    }
    return;
  }
  const Vector3 d = test::Unit({z[0], z[1], 1.0}), h = test::Unit(s.in_camera_j);
  const Vector3 axis = test::Unit({s.measurement.point_j[0], s.measurement.point_j[1], 1.0});
  const Vector3 across = test::CrossOf(axis, {h[0] - d[0], h[1] - d[1], h[2] - d[2]});
  const Real length =
      std::sqrt(across[0] * across[0] + across[1] * across[1] + across[2] * across[2]);
  ASSERT_NEAR(std::hypot(values.residuals[0], values.residuals[1]), static_cast<double>(length),
              1e-12)
      << index;
}

// A bearing that is estimated, where the measurement has it otherwise.
void ExpectBearingIsThePoint(ViewState s, const BodyReprojectionFamily& exact, Views views,
                             TimeOffset offset, Error error, int index) {
  const FactorValues expected = EvaluateFactor(exact, s.state);
  std::vector<double>& feature =
      s.state.parameters[s.state.parameters.size() - (offset == TimeOffset::kEstimated ? 2 : 1)];
  feature = {s.measurement.point_i[0], s.measurement.point_i[1], feature[0]};
  s.measurement.point_i[0] = s.measurement.point_i[1] = 1e3;  // not looked at
  BodyReprojectionFamily family(offset, Feature::kBearing, views, error);
  family.Add(s.measurement);
  ASSERT_EQ(EvaluateFactor(family, s.state).residuals, expected.residuals) << index;
  test::ExpectNumericJacobians(family, s.state, 1e-7, index);
}

TEST(BodyViews, ResidualsAreThoseOfPointsMovedTheLongWayRoundAndJacobiansNumericOnes) {
  for (const Views views :
       {Views::kTwoPoses, Views::kTwoPosesTwoCameras, Views::kOnePoseTwoCameras}) {
    for (const TimeOffset offset : {TimeOffset::kNone, TimeOffset::kEstimated}) {
      for (const Error error : {Error::kPlane, Error::kUnitSphere}) {
        test::Random random(81);
        for (int i = 0; i < 100; ++i) {
          const ViewState s = RandomView(random, views, offset);
          ExpectResidual(s, views, offset, error, i);
          BodyReprojectionFamily family(offset, Feature::kInverseDepth, views, error);
          family.Add(s.measurement);
          test::ExpectNumericJacobians(family, s.state, 1e-7, i);
          ExpectBearingIsThePoint(s, family, views, offset, error, i);
        }
      }
    }
  }
}

TEST(BodyViews, OnTheSphereTheCamerasPlaneIsAPlaceLikeOthersAndItsCenterFails) {
  const std::vector<double> origin{0, 0, 0, 0, 0, 0, 1};
  const double half = std::sqrt(0.5);
  BodyReprojectionFamily plane(TimeOffset::kNone, Feature::kInverseDepth,
                               Views::kOnePoseTwoCameras);
  BodyReprojectionFamily sphere(TimeOffset::kNone, Feature::kInverseDepth,
                                Views::kOnePoseTwoCameras, Error::kUnitSphere);
  plane.Add({});
  sphere.Add({});
  // The feature is on the axis of the first camera; the second one looks along x.
  test::FactorState state{{origin, {0, 0, 1, 0, half, 0, half}, {0.5}}, {&kPose, &kPose, nullptr}};
  state.parameters[1][2] = 2.0;
  EXPECT_STREQ(EvaluateFactor(sphere, state).failure.reason,
               "the feature lies in the center of the observing camera");
  state.parameters[1] = {0, 0, 2, 0, 0, 0, 1};
  EXPECT_STREQ(EvaluateFactor(plane, state).failure.reason,
               "the feature lies in the observing camera's plane (depth 0)");
  state.parameters[1] = {1, 0, 2, 0, 0, 0, 1};
  const FactorValues values = EvaluateFactor(sphere, state);
  ASSERT_FALSE(values.failure.failed());
  EXPECT_NEAR(std::hypot(values.residuals[0], values.residuals[1]), 1.0, 1e-15)
      << "seen at a right angle to where it is";
}

}  // namespace
}  // namespace inceres
