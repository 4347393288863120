// Landmarks seen by a camera on a body, as pixels, stereo pixels and bearings: residuals against
// long double, Jacobians against numeric ones, for points and homogeneous points on each manifold
// that they are meant for.
#include <cmath>
#include <limits>
#include <string>

#include <gtest/gtest.h>

#include "factors/visual_states.h"
#include "inceres/factors/equidistant_reprojection.h"
#include "inceres/factors/point_reprojection.h"

namespace inceres {
namespace {

using test::EvaluateFactor;
using test::FactorValues;
using test::Real;
using test::SeenLandmark;
using test::Vector3;

const PoseManifold kRightPose;
const LeftPoseManifold kLeftPose;
const SphereManifold kSphere(4);
const SubsetManifold kOmegaHeld(4, {3});

// The variants of a family: kind of landmark, its manifold, side of the perturbation.
struct Variant {
  const char* name;
  LandmarkKind landmark;
  Perturbation perturbation;
  const Manifold* pose_manifold;
  const Manifold* landmark_manifold;
};

const Variant kVariants[] = {
    {"point", LandmarkKind::kPoint, Perturbation::kRight, &kRightPose, nullptr},
    {"point, left", LandmarkKind::kPoint, Perturbation::kLeft, &kLeftPose, nullptr},
    {"sphere", LandmarkKind::kHomogeneous, Perturbation::kRight, &kRightPose, &kSphere},
    {"w held, left", LandmarkKind::kHomogeneous, Perturbation::kLeft, &kLeftPose, &kOmegaHeld},
};

const PinholeCamera kPinhole{461.0, 458.0, 365.0, 247.0, -0.28, 0.07, 2e-4, -1.8e-3};
const StereoCamera kStereo{435.0, 437.0, 367.0, 252.0, 0.11};

void ExpectNear(const std::vector<double>& actual, const std::vector<Real>& expected,
                const std::string& what) {
  ASSERT_EQ(actual.size(), expected.size());
  for (std::size_t r = 0; r < expected.size(); ++r) {
    ASSERT_NEAR(actual[r], static_cast<double>(expected[r]),
                1e-9 * (1.0 + std::fabs(static_cast<double>(expected[r]))))
        << what << ", row " << r;
  }
}

// The textbook form, with OpenCV's words.
std::vector<Real> ExpectedPixels(const PixelObservation& seen, const Vector3& P) {
  const Real x = P[0] / P[2], y = P[1] / P[2], r = std::sqrt(x * x + y * y);
  const Real radial = kPinhole.k1 * std::pow(r, 2) + kPinhole.k2 * std::pow(r, 4);
  const Real x_distorted =
      x + x * radial + 2 * kPinhole.p1 * x * y + kPinhole.p2 * (r * r + 2 * x * x);
  const Real y_distorted =
      y + y * radial + kPinhole.p1 * (r * r + 2 * y * y) + 2 * kPinhole.p2 * x * y;
  const Real e[2] = {kPinhole.f_x * x_distorted + kPinhole.c_x - seen.pixel[0],
                     kPinhole.f_y * y_distorted + kPinhole.c_y - seen.pixel[1]};
  const double* U = seen.sqrt_information;
  return {U[0] * e[0] + U[1] * e[1], U[2] * e[1]};
}

TEST(PointFamilies, PixelsAreTheCamerasAndJacobiansNumericOnes) {
  for (const Variant& variant : kVariants) {
    test::Random random(71);
    for (int i = 0; i < 250; ++i) {
      const SeenLandmark s = RandomSeenLandmark(random, variant.landmark, variant.pose_manifold,
                                                variant.landmark_manifold);
      const PixelObservation seen{
          {365.0 + 300.0 * random.Unit(), 247.0 + 200.0 * random.Unit()},
          {random.Between(0.5, 2.0), random.Unit(), random.Between(0.5, 2.0)}};
      PointReprojectionFamily family(kPinhole, variant.landmark, variant.perturbation);
      family.Add(seen);
      const FactorValues values = EvaluateFactor(family, s.state);
      ASSERT_FALSE(values.failure.failed()) << values.failure.reason;
      ExpectNear(values.residuals, ExpectedPixels(seen, s.in_camera), variant.name);
      test::ExpectNumericJacobians(family, s.state, 2e-7, i);
    }
  }
}

const EquidistantCamera kFisheye{285.0, 286.0, 424.0, 400.0, -0.007, 0.043, -0.041, 0.0075};

// OpenCV's words: fisheye::projectPoints.
std::vector<Real> ExpectedFisheye(const PixelObservation& seen, const Vector3& P) {
  const Real r = std::sqrt(P[0] * P[0] + P[1] * P[1]), theta = std::atan2(r, P[2]);
  const Real k[4] = {kFisheye.k1, kFisheye.k2, kFisheye.k3, kFisheye.k4};
  Real theta_d = theta;
  for (int i = 0; i < 4; ++i) {
    theta_d += k[i] * std::pow(theta, 2 * i + 3);
  }
  const Real e[2] = {kFisheye.f_x * theta_d / r * P[0] + kFisheye.c_x - seen.pixel[0],
                     kFisheye.f_y * theta_d / r * P[1] + kFisheye.c_y - seen.pixel[1]};
  const double* U = seen.sqrt_information;
  return {U[0] * e[0] + U[1] * e[1], U[2] * e[1]};
}

TEST(PointFamilies, FisheyePixelsAreTheCamerasAndJacobiansNumericOnesBehindTheImagePlaneToo) {
  for (const Variant& variant : kVariants) {
    test::Random random(75);
    int num_behind = 0;
    for (int i = 0; i < 250; ++i) {
      const SeenLandmark s = RandomSeenLandmark(random, variant.landmark, variant.pose_manifold,
                                                variant.landmark_manifold);
      num_behind += s.in_camera[2] < 0 ? 1 : 0;
      const PixelObservation seen{
          {424.0 + 300.0 * random.Unit(), 400.0 + 200.0 * random.Unit()},
          {random.Between(0.5, 2.0), random.Unit(), random.Between(0.5, 2.0)}};
      EquidistantReprojectionFamily family(kFisheye, variant.landmark, variant.perturbation);
      family.Add(seen);
      const FactorValues values = EvaluateFactor(family, s.state);
      ASSERT_FALSE(values.failure.failed()) << values.failure.reason;
      ExpectNear(values.residuals, ExpectedFisheye(seen, s.in_camera), variant.name);
      test::ExpectNumericJacobians(family, s.state, 2e-7, i);
    }
    EXPECT_GT(num_behind, 10) << variant.name;
  }
}

TEST(PointFamilies, AFisheyeIsSmoothOnItsAxisAndFailsStraightBehind) {
  const std::vector<double> origin{0, 0, 0, 0, 0, 0, 1};
  test::FactorState state{{origin, origin, {0.0, 0.0, 2.0}}, {&kRightPose, &kRightPose, nullptr}};
  EquidistantReprojectionFamily family(kFisheye);
  family.Add({});
  for (const double off : {0.0, 1e-12, 1e-9, 1e-7, 1e-5, 1e-3}) {
    state.parameters[2] = {off, -0.5 * off, 2.0};
    const FactorValues values = EvaluateFactor(family, state);
    ASSERT_FALSE(values.failure.failed()) << off << ": " << values.failure.reason;
    EXPECT_NEAR(values.residuals[0], kFisheye.c_x + kFisheye.f_x * off / 2.0, 1e-6);
    test::ExpectNumericJacobians(family, state, 2e-7, 0);
  }
  for (const double z : {0.0, -1.0}) {
    state.parameters[2] = {0.0, 0.0, z};
    EXPECT_STREQ(EvaluateFactor(family, state).failure.reason,
                 "the landmark lies straight behind the camera, or in its center");
  }
}

TEST(PointFamilies, StereoPixelsAreThoseOfTwoCamerasAndJacobiansNumericOnes) {
  for (const Variant& variant : kVariants) {
    test::Random random(72);
    for (int i = 0; i < 250; ++i) {
      const SeenLandmark s = RandomSeenLandmark(random, variant.landmark, variant.pose_manifold,
                                                variant.landmark_manifold);
      StereoObservation seen{
          {300.0 * random.Unit(), 300.0 * random.Unit()}, 300.0 * random.Unit(), {}};
      for (int r = 0; r < 3; ++r) {
        for (int c = r; c < 3; ++c) {
          seen.sqrt_information[3 * r + c] = r == c ? random.Between(0.5, 2.0) : random.Unit();
        }
      }
      StereoReprojectionFamily family(kStereo, variant.landmark, variant.perturbation);
      family.Add(seen);
      const FactorValues values = EvaluateFactor(family, s.state);
      ASSERT_FALSE(values.failure.failed()) << values.failure.reason;
      // The right camera is another camera.
      const Vector3& left = s.in_camera;
      const Vector3 right{left[0] - kStereo.baseline, left[1], left[2]};
      const Real e[3] = {kStereo.f_x * left[0] / left[2] + kStereo.c_x - seen.left[0],
                         kStereo.f_y * left[1] / left[2] + kStereo.c_y - seen.left[1],
                         kStereo.f_x * right[0] / right[2] + kStereo.c_x - seen.right_u};
      const double* U = seen.sqrt_information;
      ExpectNear(values.residuals,
                 {U[0] * e[0] + U[1] * e[1] + U[2] * e[2], U[4] * e[1] + U[5] * e[2], U[8] * e[2]},
                 variant.name);
      test::ExpectNumericJacobians(family, s.state, 2e-7, i);
    }
  }
}

TEST(PointFamilies, ABearingIsTheSineOfTheAngleAndJacobiansNumericOnes) {
  for (const Variant& variant : kVariants) {
    test::Random random(73);
    for (int i = 0; i < 250; ++i) {
      const SeenLandmark s = RandomSeenLandmark(random, variant.landmark, variant.pose_manifold,
                                                variant.landmark_manifold);
      const std::vector<double> direction = random.Vector(3);
      BearingObservation seen;
      std::copy_n(direction.data(), 3, seen.direction);
      BearingFamily family(variant.landmark, variant.perturbation);
      family.Add(seen);
      const FactorValues plain = EvaluateFactor(family, s.state);
      ASSERT_FALSE(plain.failure.failed()) << plain.failure.reason;
      const Vector3 across = test::CrossOf(test::Unit({direction[0], direction[1], direction[2]}),
                                           test::Unit(s.in_camera));
      const double sine = static_cast<double>(
          std::sqrt(across[0] * across[0] + across[1] * across[1] + across[2] * across[2]));
      EXPECT_NEAR(std::hypot(plain.residuals[0], plain.residuals[1]), sine, 1e-12) << variant.name;

      const double U[3] = {random.Between(100.0, 600.0), 100.0 * random.Unit(),
                           random.Between(100.0, 600.0)};
      std::copy_n(U, 3, seen.sqrt_information);
      family.Place(0, seen);
      const FactorValues values = EvaluateFactor(family, s.state);
      ExpectNear(values.residuals,
                 {U[0] * plain.residuals[0] + U[1] * plain.residuals[1], U[2] * plain.residuals[1]},
                 variant.name);
      test::ExpectNumericJacobians(family, s.state, 2e-7, i);
    }
  }
}

TEST(PointFamilies, ABearingNearTheAxisIsTheImagesXAndY) {
  const std::vector<double> origin{0, 0, 0, 0, 0, 0, 1};
  for (const double sign : {1.0, -1.0}) {
    BearingFamily family;
    family.Add({{0.0, 0.0, 2.0 * sign}, {1.0, 0.0, 1.0}});
    const FactorValues values = EvaluateFactor(
        family, {{origin, origin, {3e-5, 2e-5, sign * 1.0}}, {&kRightPose, &kRightPose, nullptr}});
    EXPECT_NEAR(values.residuals[0], 3e-5, 1e-12);
    EXPECT_NEAR(values.residuals[1], sign * 2e-5, 1e-12);
  }
}

TEST(PointFamilies, APointAtInfinityIsAPointLikeOthers) {
  test::Random random(74);
  for (int i = 0; i < 50; ++i) {
    const std::vector<double> body = test::RandomPose(random), camera = test::RandomPose(random);
    const Vector3 ray{0.4 * random.Unit(), 0.4 * random.Unit(), 1.0};
    const Vector3 direction = test::Turn(body.data() + 3, test::Turn(camera.data() + 3, ray));
    std::vector<double> landmark(4, 0.0);
    for (std::size_t k = 0; k < 3; ++k) {
      landmark[k] = static_cast<double>(direction[k]);
    }
    PointReprojectionFamily family(kPinhole, LandmarkKind::kHomogeneous);
    const PixelObservation seen{{300.0, 200.0}, {1.0, 0.0, 1.0}};
    family.Add(seen);
    const test::FactorState state{{body, camera, landmark}, {&kRightPose, &kRightPose, &kSphere}};
    ExpectNear(EvaluateFactor(family, state).residuals, ExpectedPixels(seen, ray), "at infinity");
    // Where the body is makes no difference: the differences below leave rounding.
    test::ExpectNumericJacobians(family, state, 1e-6, i);
  }
}

TEST(PointFamilies, FailInTheCamerasPlaneOrCenterAndOnNonFiniteValues) {
  const std::vector<double> origin{0, 0, 0, 0, 0, 0, 1};
  test::FactorState in_plane{{origin, origin, {1.0, 2.0, 0.0}},
                             {&kRightPose, &kRightPose, nullptr}};
  PointReprojectionFamily pixels(kPinhole);
  StereoReprojectionFamily stereo(kStereo);
  BearingFamily bearing;
  pixels.Add({});
  stereo.Add({});
  bearing.Add({});
  for (const FactorFamily* family :
       {static_cast<const FactorFamily*>(&pixels), static_cast<const FactorFamily*>(&stereo)}) {
    const FactorValues values = EvaluateFactor(*family, in_plane);
    EXPECT_EQ(values.failure.factor, 0) << family->Name();
    EXPECT_STREQ(values.failure.reason, "the landmark lies in the camera's plane (depth 0)")
        << family->Name();
  }
  EXPECT_FALSE(EvaluateFactor(bearing, in_plane).failure.failed())
      << "a bearing of 90 degrees is one";
  in_plane.parameters[2] = {0.0, 0.0, 0.0};
  EXPECT_STREQ(EvaluateFactor(bearing, in_plane).failure.reason,
               "the landmark lies in the center of the camera");
  in_plane.parameters[2] = {0.0, std::numeric_limits<double>::quiet_NaN(), 1.0};
  for (const FactorFamily* family :
       {static_cast<const FactorFamily*>(&pixels), static_cast<const FactorFamily*>(&stereo),
        static_cast<const FactorFamily*>(&bearing)}) {
    EXPECT_STREQ(EvaluateFactor(*family, in_plane).failure.reason, "a residual is not finite")
        << family->Name();
  }
}

}  // namespace
}  // namespace inceres
