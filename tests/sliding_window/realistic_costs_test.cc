// The cost functions that cost what those of estimators in the field do say what the lean ones say.

#include <algorithm>

#include <gtest/gtest.h>

#include "common/imu_residual.h"
#include "okvis/imu_error.h"
#include "okvis/realistic_errors.h"
#include "okvis/reprojection_error.h"
#include "sliding_window/numeric_jacobian.h"
#include "sliding_window/random_state.h"
#include "vins/imu_factor.h"
#include "vins/projection_factor.h"
#include "vins/realistic_factors.h"

namespace sliding_window {
namespace {

constexpr unsigned kNumCosts = 200;
constexpr double kFocalLength = 460.0, kPixelSigma = 1.5;

// Residual and Jacobians, each against its largest entry; and the residual without Jacobians.
void ExpectTheSame(const ceres::CostFunction& lean, const ceres::CostFunction& realistic,
                   const Values& x, double tolerance) {
  const LinearizedFactor a = Linearize(lean, nullptr, Pointers(x));
  const LinearizedFactor b = Linearize(realistic, nullptr, Pointers(x));
  ASSERT_EQ(a.r.size(), b.r.size());
  EXPECT_LE((a.r - b.r).cwiseAbs().maxCoeff(),
            tolerance * std::max(1.0, a.r.cwiseAbs().maxCoeff()));
  EXPECT_EQ(ResidualAt(realistic, x), b.r);
  ASSERT_EQ(a.J.size(), b.J.size());
  for (std::size_t i = 0; i < a.J.size(); ++i) {
    EXPECT_LE((a.J[i] - b.J[i]).cwiseAbs().maxCoeff(), tolerance * a.J[i].cwiseAbs().maxCoeff())
        << "block " << i;
  }
}

// Constants have no Jacobian.
void ExpectNullJacobiansAreLeftAlone(const ceres::CostFunction& cost, const Values& x) {
  Eigen::VectorXd r(cost.num_residuals());
  std::vector<double*> none(x.size(), nullptr);
  EXPECT_TRUE(cost.Evaluate(Pointers(x).data(), r.data(), none.data()));
  EXPECT_EQ(r, ResidualAt(cost, x));
}

TEST(RealisticCosts, Projection) {
  RandomState random(1);
  for (unsigned i = 0; i < kNumCosts; ++i) {
    const Pose pose = random.AnyPose();
    const Eigen::Vector2d xy_i = random.Vector(0.5).head<2>();
    const Eigen::Vector2d xy_j = random.Vector(0.5).head<2>();
    const Values x{ToVector(pose),
                   ToVector(pose * Pose{random.Vector(0.2), Exp(random.Vector(0.2))}),
                   ToVector({random.Vector(0.5), Exp(random.Vector(0.5))}),
                   {random.Uniform(0.1, 0.8)}};
    const RealisticProjectionFactor realistic(xy_i, xy_j, kFocalLength / kPixelSigma);
    ExpectTheSame(ProjectionFactor(xy_i, xy_j, kFocalLength / kPixelSigma), realistic, x, 1e-10);
    ExpectNullJacobiansAreLeftAlone(realistic, x);
  }
}

TEST(RealisticCosts, ReprojectionAlsoBehindTheCamera) {
  RandomState random(2);
  for (unsigned i = 0; i < kNumCosts; ++i) {
    const Pose pose = random.AnyPose();
    const Pose extrinsic{random.Vector(0.5), Exp(random.Vector(0.5))};
    const double w = random.Uniform(0.5, 2.0);
    const double depth = i % 10 == 0 ? -2.0 : random.Uniform(0.5, 9.0);
    const Eigen::Vector3d p =
        pose * (extrinsic * (depth * random.Vector(0.5).head<2>().homogeneous()));
    const Values x{ToVector(pose), {w * p.x(), w * p.y(), w * p.z(), w}, ToVector(extrinsic)};
    const Eigen::Vector2d xy = random.Vector(0.5).head<2>();
    const RealisticReprojectionError realistic(xy, kFocalLength, kPixelSigma);
    ExpectTheSame(ReprojectionError(xy, kFocalLength / kPixelSigma), realistic, x, 1e-10);
    ExpectNullJacobiansAreLeftAlone(realistic, x);
  }
}

// Biases near those of the integration and away from them, where ImuError integrates anew.
TEST(RealisticCosts, Imu) {
  for (unsigned seed = 0; seed < kNumCosts; ++seed) {
    RandomState random(seed);
    const std::vector<ImuSample> samples = random.Samples();
    const ImuState i = random.AnyState();
    const Eigen::Vector3d bg = i.bg + random.Vector(seed % 2 == 0 ? 1e-5 : 0.05);
    const auto imu = std::make_shared<ImuPreintegration>(ImuNoise(), samples, i.ba, bg);
    ImuState j = Propagate(*imu, i);
    j.pose = j.pose * Pose{random.Vector(1e-2), Exp(random.Vector(1e-2))};
    j.v += random.Vector(1e-2);
    const Values of_vins = ImuValues(i, j, StateToParameters);
    // An inverted covariance has lost digits: its condition number is 1e9.
    ExpectTheSame(ImuFactor(imu), RealisticImuFactor(imu), of_vins, 1e-6);
    ExpectNullJacobiansAreLeftAlone(RealisticImuFactor(imu), of_vins);
    const Values of_okvis = ImuValues(i, j, StateToBlocks);
    ExpectTheSame(ImuError({}, samples, i.ba, bg), RealisticImuError({}, samples, i.ba, bg),
                  of_okvis, 1e-9);
    ExpectNullJacobiansAreLeftAlone(RealisticImuError({}, samples, i.ba, bg), of_okvis);
  }
}

TEST(RealisticCosts, TheCamerasDerivativeIsThatOfItsDistortedImage) {
  RandomState random(3);
  for (unsigned i = 0; i < kNumCosts; ++i) {
    DistortedCamera camera;
    camera.focal_length = kFocalLength;
    camera.distortion << random.Vector(0.2), random.Uniform(-0.1, 0.1);
    Eigen::Vector4d point;
    point << random.Vector(0.5) + 2.0 * Eigen::Vector3d::UnitZ(), 1.0;
    Eigen::Matrix<double, 2, 4> J;
    camera.Project(point, &J);
    for (int k = 0; k < 4; ++k) {
      const Eigen::Vector4d step = 1e-5 * Eigen::Vector4d::Unit(k);
      const Eigen::Vector2d difference =
          (camera.Project(point + step, nullptr) - camera.Project(point - step, nullptr)) / 2e-5;
      EXPECT_LT((J.col(k) - difference).norm(), 1e-6 * kFocalLength);
    }
  }
}

}  // namespace
}  // namespace sliding_window
