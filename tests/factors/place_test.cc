// Place(index, measurement) of the built-in families: overwrites, appends at the end, writes
// nothing beyond.
#include <memory>

#include <gtest/gtest.h>

#include "inceres/factors/bal_reprojection.h"
#include "inceres/factors/body_reprojection.h"
#include "inceres/factors/diagonal_prior.h"
#include "inceres/factors/imu_factor.h"
#include "inceres/factors/point_reprojection.h"
#include "inceres/factors/pose_prior.h"
#include "inceres/factors/relative_pose.h"

namespace inceres {
namespace {

// Residuals of all factors of the family, each at the same parameters.
std::vector<double> Residuals(const FactorFamily& family,
                              const std::vector<std::vector<double>>& values) {
  std::vector<const double*> parameters;
  for (int i = 0; i < family.size(); ++i) {
    for (const std::vector<double>& slot : values) {
      parameters.push_back(slot.data());
    }
  }
  std::vector<double> residuals(static_cast<std::size_t>(family.size() * family.residual_size()));
  FactorBatch batch;
  batch.end = family.size();
  batch.parameters = parameters.data();
  batch.residuals = residuals.data();
  EXPECT_FALSE(family.Evaluate(batch).failed());
  return residuals;
}

// Of a family that is made with `arguments`.
template <typename Family, typename... Arguments>
void ExpectPlaces(const typename Family::Measurement& a, const typename Family::Measurement& b,
                  const std::vector<std::vector<double>>& values, const Arguments&... arguments) {
  Family added(arguments...), placed(arguments...);
  added.Add(a);
  added.Add(b);
  added.Add(a);
  placed.Place(0, b);
  placed.Place(1, a);
  placed.Place(2, a);
  placed.Place(4, b);
  EXPECT_EQ(placed.size(), 3);
  EXPECT_NE(Residuals(placed, values), Residuals(added, values));
  placed.Place(0, a);
  placed.Place(1, b);
  EXPECT_EQ(placed.size(), 3);
  EXPECT_EQ(Residuals(placed, values), Residuals(added, values));
}

const std::vector<double> kPoseA = {0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0};
const std::vector<double> kPoseB = {1.1, -0.2, 0.4, 0.0, 0.6, 0.0, 0.8};

TEST(Place, BalReprojection) {
  ExpectPlaces<BalReprojectionFamily>(
      {1.0, 2.0}, {3.0, -4.0}, {{0.1, 0.2, 0.3, 0.0, 0.0, -5.0, 500.0, 0.0, 0.0}, {0.1, 0.2, 0.3}});
}

TEST(Place, DiagonalPrior) {
  ExpectPlaces<DiagonalPriorFamily>({{1.0, 2.0}, {3.0, 4.0}}, {{-1.0, 0.0}, {2.0, 1.0}},
                                    {{0.5, 0.25}}, 2);
}

TEST(Place, InverseDepthReprojection) {
  InverseDepthReprojectionFamily::Measurement b;
  b.observed_point[0] = 0.3;
  b.sqrt_information[0] = 2.0;
  ExpectPlaces<InverseDepthReprojectionFamily>({}, b, {kPoseA, kPoseB, {0.5}});
}

TEST(Place, BodyReprojection) {
  BodyReprojectionFamily::Measurement b;
  b.point_j[0] = 0.3;
  ExpectPlaces<BodyReprojectionFamily>({}, b, {kPoseA, kPoseB, kPoseA, {0.5}});
}

TEST(Place, PointFamilies) {
  const std::vector<std::vector<double>> values{kPoseA, kPoseB, {0.5, 0.7, 4.0}};
  ExpectPlaces<PointReprojectionFamily>({}, {{0.3, 0.1}, {1.0, 0.0, 1.0}}, values, PinholeCamera{});
  StereoObservation stereo;
  stereo.right_u = 0.2;
  ExpectPlaces<StereoReprojectionFamily>({}, stereo, values, StereoCamera{});
  ExpectPlaces<BearingFamily>({}, {{0.3, 0.1, 1.0}, {1.0, 0.0, 1.0}}, values);
}

TEST(Place, RelativePose) {
  RelativePoseFamily::Measurement a;
  RelativePoseFamily::Measurement b;
  for (int k = 0; k < 6; ++k) {
    a.sqrt_information[7 * k] = 1.0;
    b.sqrt_information[7 * k] = 2.0;
  }
  b.p_ab[1] = 0.7;
  ExpectPlaces<RelativePoseFamily>(a, b, {kPoseA, kPoseB});
}

TEST(Place, PoseEdge) {
  PoseEdgeFamily::Measurement a;
  PoseEdgeFamily::Measurement b;
  for (int k = 0; k < 6; ++k) {
    a.sqrt_information[7 * k] = 1.0;
    b.sqrt_information[7 * k] = 2.0;
  }
  b.p_m[1] = 0.7;
  ExpectPlaces<PoseEdgeFamily>(a, b, {kPoseA, kPoseB}, PoseErrorConvention::kGtsam);
}

TEST(Place, RelativeSimilarity) {
  RelativeSimilarityFamily::Measurement a;
  RelativeSimilarityFamily::Measurement b;
  for (int k = 0; k < 7; ++k) {
    a.sqrt_information[8 * k] = 1.0;
    b.sqrt_information[8 * k] = 2.0;
  }
  b.s_m = 0.7;
  std::vector<double> from = kPoseA, to = kPoseB;
  from.push_back(1.5);
  to.push_back(0.8);
  ExpectPlaces<RelativeSimilarityFamily>(a, b, {from, to}, SimilarityErrorConvention::kLogarithm);
}

TEST(Place, PosePrior) {
  PosePriorFamily::Measurement b;
  b.sqrt_information[0] = 2.0;
  ExpectPlaces<PosePriorFamily>({}, b, {kPoseA});
}

TEST(Place, SpeedBiasPrior) {
  SpeedBiasPriorFamily::Measurement b;
  b.sqrt_information[8] = 2.0;
  ExpectPlaces<SpeedBiasPriorFamily>({}, b, {std::vector<double>(9, 0.3)});
}

TEST(Place, ImuFactor) {
  ImuPreintegrator imu[2];
  for (const int k : {0, 1}) {
    std::vector<ImuSample> samples(3);
    samples[1].time = 0.1;
    samples[2].time = 0.2 + 0.1 * k;
    const double bias[3] = {0.0, 0.0, 0.0};
    ASSERT_TRUE(imu[k].Integrate(samples, bias, bias).ok());
  }
  const std::vector<double> speed_bias(9, 0.01);
  ExpectPlaces<ImuFactorFamily>(imu[0], imu[1], {kPoseA, speed_bias, kPoseB, speed_bias});
}

}  // namespace
}  // namespace inceres
