// The preintegrated IMU against motions in closed form, numeric differences and sampling.

#include <gtest/gtest.h>

#include "common/imu_residual.h"
#include "common/simulator.h"
#include "sliding_window/random_state.h"

namespace sliding_window {
namespace {

using Eigen::Vector3d;
using Imu = ImuPreintegration;

TEST(ImuPreintegration, StraightMotionIsExact) {
  std::vector<ImuSample> samples;
  const Vector3d a(0.3, -0.2, 0.1);
  for (int i = 0; i <= 20; ++i) {
    samples.push_back({0.005 * i, kGravity + a, Vector3d::Zero()});
  }
  ImuState i;
  i.v = Vector3d(1.0, 2.0, -1.0);
  const ImuState j = Propagate(Imu({}, samples, Vector3d::Zero(), Vector3d::Zero()), i);
  EXPECT_LT((j.pose.p - (0.1 * i.v + 0.005 * a)).norm(), 1e-14);
  EXPECT_LT((j.v - (i.v + 0.1 * a)).norm(), 1e-14);
  EXPECT_EQ(j.pose.q.coeffs(), Eigen::Quaterniond::Identity().coeffs());
}

// A circle of radius 2 at 1.5 rad/s, facing along it: turn rate and specific force are constant in
// body axes.
TEST(ImuPreintegration, CircleIsExactToTheOrderOfTheMidPointRule) {
  const double w = 1.5;
  const double radius = 2.0;
  const auto error_of = [&](int num_samples) {
    const double dt = 1.0 / num_samples;
    std::vector<ImuSample> samples;
    for (int i = 0; i <= num_samples; ++i) {
      samples.push_back(
          {dt * i, Vector3d(0.0, radius * w * w, 0.0) + kGravity, Vector3d(0.0, 0.0, w)});
    }
    ImuState i;
    i.pose.p = Vector3d(0.0, -radius, 0.0);
    i.v = Vector3d(radius * w, 0.0, 0.0);
    const ImuState j = Propagate(Imu({}, samples, Vector3d::Zero(), Vector3d::Zero()), i);
    EXPECT_LT(j.pose.q.angularDistance(Exp(Vector3d(0.0, 0.0, w))), 1e-12);
    return (j.pose.p - radius * Vector3d(std::sin(w), -std::cos(w), 0.0)).norm();
  };
  const double coarse = error_of(100);
  EXPECT_LT(coarse, 2e-4);
  EXPECT_NEAR(coarse / error_of(200), 4.0, 0.2);
}

TEST(ImuPreintegration, FollowsTheSimulatedFlight) {
  SimulatorOptions options;
  options.imu_noise = {0.0, 0.0, 0.0, 0.0};
  Simulator simulator(options);
  Frame frame = simulator.Next();
  for (int k = 0; k < 30; ++k) {
    const ImuState before = simulator.Truth(frame.time);
    frame = simulator.Next();
    ImuNoise some;
    const ImuState predicted = Propagate(Imu(some, frame.imu, before.ba, before.bg), before);
    const ImuState after = simulator.Truth(frame.time);
    EXPECT_LT((predicted.pose.p - after.pose.p).norm(), 1e-5);
    EXPECT_LT((predicted.v - after.v).norm(), 1e-4);
    EXPECT_LT(predicted.pose.q.angularDistance(after.pose.q), 1e-5);
  }
}

TEST(ImuPreintegration, BiasJacobianIsADerivative) {
  for (unsigned seed = 0; seed < 50; ++seed) {
    RandomState random(seed);
    const std::vector<ImuSample> samples = random.Samples();
    const Vector3d ba = random.Vector(0.1);
    const Vector3d bg = random.Vector(0.1);
    const Imu at(ImuNoise(), samples, ba, bg);
    constexpr double kStep = 1e-5;
    for (int k = 0; k < 6; ++k) {
      const Vector3d da = k < 3 ? Vector3d(kStep * Vector3d::Unit(k)) : Vector3d::Zero();
      const Vector3d dg = k < 3 ? Vector3d::Zero() : Vector3d(kStep * Vector3d::Unit(k - 3));
      Imu ahead = at;
      Imu behind = at;
      ahead.Repropagate(ba + da, bg + dg);
      behind.Repropagate(ba - da, bg - dg);
      Eigen::Matrix<double, 9, 1> difference;
      difference << ahead.delta_p() - behind.delta_p(),
          Log(behind.delta_q().conjugate() * ahead.delta_q()), ahead.delta_v() - behind.delta_v();
      const Eigen::Matrix<double, 9, 1> column = at.jacobian().block<9, 1>(0, Imu::kBa + k);
      EXPECT_LT((difference / (2.0 * kStep) - column).norm(), 1e-8) << "column " << k;
    }
  }
}

TEST(ImuPreintegration, CovarianceIsThatOfSamples) {
  constexpr int kNumRuns = 4000;
  RandomState random(7);
  ImuNoise noise{0.1, 0.01, 0.0, 0.0};
  const std::vector<ImuSample> samples = random.Samples();
  const Imu exact(noise, samples, Vector3d::Zero(), Vector3d::Zero());
  std::normal_distribution<double> normal(0.0, 1.0 / std::sqrt(0.005));
  Eigen::Matrix<double, 9, 9> sampled = Eigen::Matrix<double, 9, 9>::Zero();
  for (int run = 0; run < kNumRuns; ++run) {
    std::vector<ImuSample> noisy = samples;
    for (ImuSample& sample : noisy) {
      for (int k = 0; k < 3; ++k) {
        sample.acc[k] += noise.acc * normal(random.engine());
        sample.gyr[k] += noise.gyr * normal(random.engine());
      }
    }
    const Imu other(noise, noisy, Vector3d::Zero(), Vector3d::Zero());
    Eigen::Matrix<double, 9, 1> e;
    e << other.delta_p() - exact.delta_p(), Log(exact.delta_q().conjugate() * other.delta_q()),
        other.delta_v() - exact.delta_v();
    sampled += e * e.transpose() / kNumRuns;
  }
  // Whitened it is the identity, but for chance and for the two half samples at the ends.
  const Eigen::Matrix<double, 9, 9> L =
      Eigen::LLT<Eigen::Matrix<double, 9, 9>>(exact.covariance().topLeftCorner<9, 9>()).matrixL();
  const Eigen::Matrix<double, 9, 9> L_inv = L.inverse();
  const Eigen::Matrix<double, 9, 9> whitened = L_inv * sampled * L_inv.transpose();
  EXPECT_LT((whitened - Eigen::Matrix<double, 9, 9>::Identity()).cwiseAbs().maxCoeff(), 0.15);
}

TEST(ImuPreintegration, AppendIsAsIfTheSamplesHadComeTogether) {
  RandomState random(8);
  const std::vector<ImuSample> samples = random.Samples();
  const Imu whole(ImuNoise(), samples, Vector3d::Ones(), Vector3d::Zero());
  Imu parts(ImuNoise(), {samples.begin(), samples.begin() + 8}, Vector3d::Ones(), Vector3d::Zero());
  parts.Append({samples.begin() + 7, samples.end()});
  EXPECT_EQ(parts.delta_p(), whole.delta_p());
  EXPECT_EQ(parts.covariance(), whole.covariance());
  EXPECT_EQ(parts.sqrt_information(), whole.sqrt_information());
  EXPECT_EQ(parts.dt(), whole.dt());
  EXPECT_LT((whole.sqrt_information() * whole.covariance() * whole.sqrt_information().transpose() -
             Imu::Matrix15::Identity())
                .norm(),
            1e-8);
}

}  // namespace
}  // namespace sliding_window
