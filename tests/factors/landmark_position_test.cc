// Landmarks seen from poses, and positions of poses: values by hand, Jacobians against numeric
// ones.
#include "inceres/factors/landmark_position.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "factors/pose_states.h"
#include "factors/wrap_angle.h"

namespace inceres {
namespace {

using test::EvaluateFactor;
using test::FactorState;
using test::FactorValues;
using test::Random;

TEST(WrapAngle, HasTheBitsOfTheRemainder) {
  Random random(11);
  for (int i = 0; i < 1000; ++i) {
    const double angle = random.Between(-10.0, 10.0);
    EXPECT_EQ(internal::WrapAngle(angle), std::remainder(angle, 2.0 * M_PI)) << angle;
  }
  for (const double angle :
       {M_PI, -M_PI, std::nextafter(M_PI, 4.0), std::nextafter(M_PI, 3.0), 2.0 * M_PI, 0.0}) {
    EXPECT_EQ(internal::WrapAngle(angle), std::remainder(angle, 2.0 * M_PI)) << angle;
  }
  EXPECT_TRUE(std::signbit(internal::WrapAngle(-0.0)));
  EXPECT_TRUE(std::isnan(internal::WrapAngle(HUGE_VAL)));
}

TEST(PlanarLandmark, JacobiansAtAThousandStates) {
  for (const PlanarSighting sighting : {PlanarSighting::kPosition, PlanarSighting::kRangeBearing}) {
    Random random(7);
    for (int i = 0; i < 1000; ++i) {
      PlanarLandmarkFamily family(sighting);
      family.Add(
          {{random.Between(-3.0, 3.0), random.Between(-3.0, 3.0)},
           {random.Between(0.5, 2.0), random.Between(-1.0, 1.0), 0.0, random.Between(0.5, 2.0)}});
      const double angle = random.Between(-10.0, 10.0), far = random.Between(0.2, 5.0);
      const double direction = random.Between(-3.0, 3.0);
      const double x = random.Between(-3.0, 3.0), y = random.Between(-3.0, 3.0);
      const FactorState state{
          {{x, y, angle}, {x + far * std::cos(direction), y + far * std::sin(direction)}},
          {nullptr, nullptr}};
      // Where the bearing's error is wrapped it jumps: not there.
      const FactorValues values = EvaluateFactor(family, state);
      ASSERT_FALSE(values.failure.failed());
      const double wrapped =
          std::remainder(direction - angle - family.measurement(0).z[1], 2.0 * M_PI);
      if (sighting == PlanarSighting::kPosition || std::fabs(wrapped) < 3.1) {
        test::ExpectNumericJacobians(family, state, 1e-6, i);
      }
    }
  }
}

TEST(PlanarLandmark, ALandmarkToTheLeft) {
  // From (1, 2), looking along +y, the landmark at (−2, 6) lies 4 m ahead and 3 m to the left.
  const FactorState state{{{1.0, 2.0, M_PI / 2}, {-2.0, 6.0}}, {nullptr, nullptr}};
  PlanarLandmarkFamily position;
  position.Add({{3.5, 2.0}, {2.0, 1.0, 0.0, 4.0}});
  FactorValues values = EvaluateFactor(position, state);
  EXPECT_NEAR(values.residuals[0], 2.0 * 0.5 + 1.0, 1e-14);
  EXPECT_NEAR(values.residuals[1], 4.0 * 1.0, 1e-14);
  PlanarLandmarkFamily polar(PlanarSighting::kRangeBearing);
  polar.Add({{4.0, 2.0 * M_PI}, {1.0, 0.0, 0.0, 1.0}});
  values = EvaluateFactor(polar, state);
  EXPECT_NEAR(values.residuals[0], 1.0, 1e-14);
  EXPECT_NEAR(values.residuals[1], std::atan2(3.0, 4.0), 1e-14);
}

TEST(PlanarLandmark, RangeAndBearingFailWhereTheyAreNotDefined) {
  PlanarLandmarkFamily polar(PlanarSighting::kRangeBearing);
  polar.Add({});
  const FactorState state{{{1.0, 2.0, 0.3}, {1.0, 2.0}}, {nullptr, nullptr}};
  EXPECT_EQ(EvaluateFactor(polar, state).failure.factor, 0);
}

void RandomU(Random* random, double* U) {
  for (int k = 0; k < 9; ++k) {
    const bool below = k == 3 || k == 6 || k == 7;
    U[k] = below ? 0.0 : random->Between(0.5, 1.5);
  }
}

TEST(SpatialLandmark, JacobiansAtAThousandStates) {
  Random random(8);
  for (int i = 0; i < 1000; ++i) {
    SpatialLandmarkFamily::Measurement m;
    std::vector<double> pose(7), landmark(3);
    for (std::size_t k = 0; k < 3; ++k) {
      m.z[k] = random.Between(-3.0, 3.0);
      pose[k] = random.Between(-3.0, 3.0);
      landmark[k] = random.Between(-3.0, 3.0);
    }
    RandomU(&random, m.sqrt_information);
    test::RandomRotation(random, random.Between(0.0, 3.1), pose.data() + 3);
    SpatialLandmarkFamily family;
    family.Add(m);
    test::ExpectNumericJacobians(family, {{pose, landmark}, {&test::kPoseManifold, nullptr}}, 1e-8,
                                 i);
  }
}

TEST(SpatialLandmark, ALandmarkToTheLeft) {
  // As in the plane, half a meter up.
  const double half = std::sqrt(0.5);
  SpatialLandmarkFamily family;
  family.Add({{3.5, 2.0, 0.0}, {1, 0, 0, 0, 1, 0, 0, 0, 2}});
  const FactorValues values = EvaluateFactor(
      family, {{{1, 2, 0, 0, 0, half, half}, {-2, 6, 0.5}}, {&test::kPoseManifold, nullptr}});
  EXPECT_NEAR(values.residuals[0], 0.5, 1e-14);
  EXPECT_NEAR(values.residuals[1], 1.0, 1e-14);
  EXPECT_NEAR(values.residuals[2], 1.0, 1e-14);
}

TEST(PositionPrior, JacobiansAtAThousandStates) {
  Random random(9);
  for (int i = 0; i < 1000; ++i) {
    PositionPriorFamily::Measurement m;
    std::vector<double> pose(7);
    for (std::size_t k = 0; k < 3; ++k) {
      m.z[k] = random.Between(-3.0, 3.0);
      m.lever[k] = random.Between(-1.0, 1.0);
      pose[k] = random.Between(-3.0, 3.0);
    }
    RandomU(&random, m.sqrt_information);
    test::RandomRotation(random, random.Between(0.0, 3.1), pose.data() + 3);
    PositionPriorFamily family;
    family.Add(m);
    test::ExpectNumericJacobians(family, {{pose}, {&test::kPoseManifold}}, 1e-8, i);
  }
}

TEST(PositionPrior, SeesTheAntennaAndNotTheBody) {
  // Turned by 90° about z, an antenna a meter ahead stands at +y.
  const double half = std::sqrt(0.5);
  PositionPriorFamily family;
  family.Add({{1.0, 2.5, 3.0}, {1.0, 0.0, 0.0}, {1, 0, 0, 0, 2, 0, 0, 0, 1}});
  const FactorState state{{{1, 2, 3, 0, 0, half, half}}, {&test::kPoseManifold}};
  const FactorValues values = EvaluateFactor(family, state);
  EXPECT_NEAR(values.residuals[0], 0.0, 1e-14);
  EXPECT_NEAR(values.residuals[1], 1.0, 1e-14);
  EXPECT_NEAR(values.residuals[2], 0.0, 1e-14);
}

TEST(LandmarkPositions, FailOnNonFiniteValues) {
  const double bad = std::numeric_limits<double>::quiet_NaN();
  SpatialLandmarkFamily landmark;
  landmark.Add({});
  EXPECT_STREQ(EvaluateFactor(landmark, {{{0, 0, 0, 0, 0, 0, 1}, {bad, 0, 0}},
                                         {&test::kPoseManifold, nullptr}})
                   .failure.reason,
               "a residual is not finite");
  PositionPriorFamily prior;
  prior.Add({});
  EXPECT_STREQ(
      EvaluateFactor(prior, {{{bad, 0, 0, 0, 0, 0, 1}}, {&test::kPoseManifold}}).failure.reason,
      "a residual is not finite");
}

}  // namespace
}  // namespace inceres
