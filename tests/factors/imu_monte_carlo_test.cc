// Is the covariance the spread of what is integrated? Normalized estimation errors squared over
// seeded runs.
#include <cmath>
#include <vector>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "factors/imu_support.h"

namespace inceres {
namespace {

using test::ToVector;
using test::Vector3d;

constexpr int kRuns = 1000;
constexpr int kIntervals = 50;
constexpr double kDt = 0.005;

double Normal(test::Random& random) {
  const double radius = std::sqrt(-2.0 * std::log(random.Between(1e-300, 1.0)));
  return radius * std::cos(3.14159265358979323846 * random.Unit());
}

Vector3d Normal3(test::Random& random, double sigma) {
  return sigma * Vector3d(Normal(random), Normal(random), Normal(random));
}

// Mean of eᵀΣ⁻¹e over the runs, for `size` leading entries of the error (φ, v, p, b_g, b_a); the
// sensor's noise is `factor` times what the preintegration believes.
double MeanNees(const ImuOptions& options, int size, double factor) {
  test::Random random(72);
  const ImuNoise& noise = options.noise;
  const bool continuous = options.conventions.noise == ImuConventions::Noise::kContinuous;
  const double per_sample = factor / (continuous ? std::sqrt(kDt) : 1.0);
  const double per_walk = size < 15 ? 0.0 : factor * (continuous ? std::sqrt(kDt) : kDt);
  double sum = 0.0;
  for (int run = 0; run < kRuns; ++run) {
    const std::vector<ImuSample> truth = test::LivelySamples(random, kIntervals, kDt);
    std::vector<ImuSample> measured = truth;
    Vector3d bg = Vector3d::Zero(), ba = Vector3d::Zero();
    for (std::size_t k = 0; k < measured.size(); ++k) {
      Eigen::Map<Vector3d>(measured[k].gyr) += bg + Normal3(random, noise.gyr * per_sample);
      Eigen::Map<Vector3d>(measured[k].acc) += ba + Normal3(random, noise.acc * per_sample);
      if (k + 1 < measured.size()) {
        bg += Normal3(random, noise.gyr_bias_walk * per_walk);
        ba += Normal3(random, noise.acc_bias_walk * per_walk);
      }
    }
    const ImuPreintegrator imu = test::Integrated(options, measured);
    Eigen::VectorXd e(15);
    e << test::Difference(imu.delta(), test::Integrated(options, truth).delta()), bg, ba;
    const Eigen::Map<const test::Matrix15d> covariance(imu.delta().covariance);
    e.conservativeResize(size);
    sum += e.dot(Eigen::MatrixXd(covariance.topLeftCorner(size, size)).llt().solve(e));
  }
  return sum / kRuns;
}

// The 95 % band of the mean of kRuns values of χ² with `size` degrees of freedom.
double Band(int size) {
  return 1.96 * std::sqrt(2.0 * size / kRuns);
}

ImuOptions Noisy(ImuConventions::Integration integration, bool walks) {
  ImuOptions options;
  options.noise = {2e-3, 2e-2, 3e-3, 5e-2};
  options.conventions.integration = integration;
  options.conventions.bias_walks_while_integrating = walks;
  return options;
}

TEST(ImuMonteCarlo, TheErrorIsAsLargeAsTheCovarianceSays) {
  for (const auto integration :
       {ImuConventions::Integration::kEuler, ImuConventions::Integration::kMidpoint}) {
    for (const bool walks : {false, true}) {
      const int size = walks ? 15 : 9;
      const ImuOptions options = Noisy(integration, walks);
      const double nees = MeanNees(options, size, 1.0);
      EXPECT_NEAR(nees, size, Band(size));
    }
  }
}

TEST(ImuMonteCarlo, WouldNoticeNoiseFivePercentLargerThanBelieved) {
  EXPECT_GT(MeanNees(Noisy(ImuConventions::Integration::kEuler, true), 15, 1.05), 15.0 + Band(15));
}

TEST(ImuMonteCarlo, NoisePerSampleIsThatOfASample) {
  ImuOptions options = Noisy(ImuConventions::Integration::kEuler, true);
  options.conventions.noise = ImuConventions::Noise::kPerSample;
  options.noise = {2e-2, 2e-1, 1e-2, 1e-1};
  EXPECT_NEAR(MeanNees(options, 15, 1.0), 15.0, Band(15));
}

}  // namespace
}  // namespace inceres
