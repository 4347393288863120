// The estimators' cost functions: analytic against numeric Jacobians, and what each is zero at.

#include <gtest/gtest.h>

#include "common/imu_residual.h"
#include "okvis/imu_error.h"
#include "okvis/manifolds.h"
#include "okvis/prior_errors.h"
#include "okvis/reprojection_error.h"
#include "sliding_window/numeric_jacobian.h"
#include "sliding_window/random_state.h"
#include "vins/imu_factor.h"
#include "vins/projection_factor.h"

namespace sliding_window {
namespace {

constexpr int kNumStates = 200;

Pose Near(const Pose& pose, double by, RandomState* random) {
  return pose * Pose{random->Vector(by), Exp(random->Vector(by))};
}

TEST(Manifolds, PlusAndMinusAreInverseAndTheirJacobiansToo) {
  RandomState random(1);
  const PoseManifold pose;
  const HomogeneousPointManifold point;
  for (int i = 0; i < kNumStates; ++i) {
    const std::vector<double> x = ToVector(random.AnyPose());
    for (const double size : {1.0, 1e-3, 1e-6}) {
      Eigen::Matrix<double, 6, 1> d;
      d << random.Vector(size), random.Vector(size);
      std::vector<double> y(7);
      Eigen::Matrix<double, 6, 1> back;
      ASSERT_TRUE(pose.Plus(x.data(), d.data(), y.data()));
      ASSERT_TRUE(pose.Minus(y.data(), x.data(), back.data()));
      EXPECT_LT((back - d).norm(), 1e-13 + 1e-10 * size);
    }
    RowMajorMatrix plus(7, 6);
    RowMajorMatrix minus(6, 7);
    ASSERT_TRUE(pose.PlusJacobian(x.data(), plus.data()));
    ASSERT_TRUE(pose.MinusJacobian(x.data(), minus.data()));
    EXPECT_LT((minus * plus - RowMajorMatrix::Identity(6, 6)).norm(), 1e-13);
    const double h[4] = {1.0, -2.0, 3.0, 2.0};
    const double d[3] = {0.5, 0.25, 4.0};
    double moved[4];
    double back[3];
    ASSERT_TRUE(point.Plus(h, d, moved));
    ASSERT_TRUE(point.Minus(moved, h, back));
    EXPECT_EQ(moved[3], 2.0);
    EXPECT_TRUE(std::equal(d, d + 3, back));
  }
}

TEST(ProjectionFactor, JacobiansAreDerivatives) {
  RandomState random(2);
  for (int i = 0; i < kNumStates; ++i) {
    const Pose T_wi = random.AnyPose();
    const Pose T_bc = Near({}, 0.5, &random);
    const ProjectionFactor factor(random.Vector(0.5).head<2>(), random.Vector(0.5).head<2>(),
                                  460.0 / 1.5);
    const Values x{ToVector(T_wi),
                   ToVector(Near(T_wi, 0.2, &random)),
                   ToVector(T_bc),
                   {random.Uniform(0.1, 0.8)}};
    ExpectJacobiansAreDerivatives(factor, x,
                                  {ByVinsPose(), ByVinsPose(), ByVinsPose(), Straight(1)}, 1e-6);
  }
}

TEST(ReprojectionError, JacobiansAreDerivativesAndZeroBehindTheCamera) {
  RandomState random(3);
  const PoseManifold pose;
  const HomogeneousPointManifold point;
  for (int i = 0; i < kNumStates; ++i) {
    const Pose T_ws = random.AnyPose();
    const Pose T_sc = Near({}, 0.5, &random);
    const double w = random.Uniform(0.5, 2.0);
    const auto landmark_at = [&](double depth) {
      const Eigen::Vector3d p =
          T_ws * (T_sc * (depth * random.Vector(0.5).head<2>().homogeneous()));
      return std::vector<double>{w * p.x(), w * p.y(), w * p.z(), w};
    };
    const ReprojectionError error(random.Vector(0.5).head<2>(), 460.0 / 1.5);
    ExpectJacobiansAreDerivatives(
        error, {ToVector(T_ws), landmark_at(random.Uniform(1.0, 9.0)), ToVector(T_sc)},
        {By(pose), By(point), By(pose)}, 1e-6);
    const Values behind{ToVector(T_ws), landmark_at(-2.0), ToVector(T_sc)};
    for (const RowMajorMatrix& J : Linearize(error, nullptr, Pointers(behind)).J) {
      EXPECT_EQ(J.norm(), 0.0);
    }
  }
}

// One interval, and two states that nearly agree with it.
struct ImuCase {
  explicit ImuCase(unsigned seed) : random(seed), i(random.AnyState()) {
    const ImuPreintegration imu({}, samples, i.ba, i.bg);
    j = Propagate(imu, i);
    j.pose = Near(j.pose, 1e-2, &random);
    j.v += random.Vector(1e-2);
    j.bg += random.Vector(1e-4);
  }
  RandomState random;
  std::vector<ImuSample> samples = random.Samples();
  ImuState i, j;
};

TEST(ImuFactor, JacobiansAreDerivativesAlsoAwayFromTheBiasOfTheIntegration) {
  for (unsigned seed = 0; seed < kNumStates; ++seed) {
    ImuCase at(seed);
    const auto imu = std::make_shared<ImuPreintegration>(
        ImuNoise(), at.samples, at.i.ba + at.random.Vector(0.05), at.i.bg + at.random.Vector(0.05));
    ExpectJacobiansAreDerivatives(ImuFactor(imu), ImuValues(at.i, at.j, StateToParameters),
                                  {ByVinsPose(), Straight(9), ByVinsPose(), Straight(9)}, 1e-6);
  }
}

TEST(ImuFactor, IsZeroAtThePropagatedState) {
  const ImuCase at(4);
  const auto imu = std::make_shared<ImuPreintegration>(ImuNoise(), at.samples, at.i.ba, at.i.bg);
  EXPECT_LT(
      ResidualAt(ImuFactor(imu), ImuValues(at.i, Propagate(*imu, at.i), StateToParameters)).norm(),
      1e-8);
}

TEST(ImuError, JacobiansAreDerivatives) {
  const PoseManifold pose;
  for (unsigned seed = 0; seed < kNumStates; ++seed) {
    const ImuCase at(seed);
    const ImuError error({}, at.samples, at.i.ba, at.i.bg);
    ExpectJacobiansAreDerivatives(error, ImuValues(at.i, at.j, StateToBlocks),
                                  {By(pose), Straight(9), By(pose), Straight(9)}, 1e-6);
    EXPECT_EQ(error.num_integrations(), 1);
  }
}

TEST(ImuError, IntegratesAnewWhenTheBiasHasMovedAndSaysTheSameAsVins) {
  ImuCase at(5);
  const ImuError error({}, at.samples, at.i.ba, at.i.bg);
  at.i.bg += Eigen::Vector3d(0.01, 0.0, 0.0);
  at.i.ba += Eigen::Vector3d(0.0, 0.1, 0.0);
  const Eigen::VectorXd r = ResidualAt(error, ImuValues(at.i, at.j, StateToBlocks));
  EXPECT_EQ(error.num_integrations(), 2);
  EXPECT_EQ(ResidualAt(error, ImuValues(at.i, at.j, StateToBlocks)), r);
  EXPECT_EQ(error.num_integrations(), 2);
  const auto imu = std::make_shared<ImuPreintegration>(ImuNoise(), at.samples, at.i.ba, at.i.bg);
  EXPECT_EQ(ResidualAt(ImuFactor(imu), ImuValues(at.i, at.j, StateToParameters)), r);
}

TEST(PriorErrors, JacobiansAreDerivatives) {
  RandomState random(6);
  const PoseManifold pose;
  for (int i = 0; i < kNumStates; ++i) {
    const Pose known = random.AnyPose();
    PoseError::Vector6 information;
    information << 1.0, 2.0, 3.0, 0.0, 5.0, 6.0;
    const PoseError pose_error(known, information);
    ExpectJacobiansAreDerivatives(pose_error, {ToVector(Near(known, 0.3, &random))}, {By(pose)},
                                  1e-7);
    EXPECT_LT(ResidualAt(pose_error, {ToVector(known)}).norm(), 1e-14);
    SpeedAndBiasError::Vector9 speed_bias;
    speed_bias << random.Vector(1.0), random.Vector(1.0), random.Vector(1.0);
    ExpectJacobiansAreDerivatives(
        SpeedAndBiasError(speed_bias, SpeedAndBiasError::Vector9::LinSpaced(1.0, 9.0)),
        {std::vector<double>(9, 0.1)}, {Straight(9)}, 1e-7);
  }
}

}  // namespace
}  // namespace sliding_window
