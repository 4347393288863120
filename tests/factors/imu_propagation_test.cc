// Propagation of a state with its covariance: as the factors imply it, step by step as in one go,
// as a Kalman filter has it.
#include <cmath>
#include <limits>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <gtest/gtest.h>

#include "factors/imu_support.h"
#include "factors/numeric_jacobian.h"
#include "inceres/factors/imu_factor.h"
#include "inceres/problem/manifolds.h"

namespace inceres {
namespace {

using test::Integrated;
using test::Matrix15d;

const PoseManifold kRight;
const LeftPoseManifold kLeft;

struct State {
  std::vector<double> pose = std::vector<double>(7);
  std::vector<double> speed_bias = std::vector<double>(9);
  Matrix15d P = Matrix15d::Identity();
};

State RandomState(test::Random& random) {
  State state;
  state.pose = random.Vector(7);
  state.speed_bias = random.Vector(9);
  test::RandomRotation(random, random.Between(0.0, 3.0), state.pose.data() + 3);
  const Matrix15d G = Eigen::Map<const Matrix15d>(random.Vector(225).data());
  state.P = 1e-4 * (Matrix15d::Identity() + 0.2 * G * G.transpose());
  return state;
}

State Propagated(const ImuPreintegrator& imu, const State& from) {
  State to;
  const Status status = PropagateImu(imu, from.pose.data(), from.speed_bias.data(), from.P.data(),
                                     to.pose.data(), to.speed_bias.data(), to.P.data());
  EXPECT_TRUE(status.ok()) << status.message;
  return to;
}

// At the state's biases, where the residual's covariance on the left is exact too (elsewhere it is
// that of the uncorrected ΔR).
ImuPreintegrator IntegratedAt(const State& state, const ImuOptions& options,
                              const std::vector<ImuSample>& samples) {
  const bool gyr_first = options.conventions.bias_order == ImuConventions::BiasOrder::kGyrFirst;
  return Integrated(options, samples, state.speed_bias.data() + (gyr_first ? 3 : 6),
                    state.speed_bias.data() + (gyr_first ? 6 : 3));
}

bool TurnsOnTheLeft(const ImuPreintegrator& imu) {
  return imu.options().conventions.perturbation == ImuConventions::Perturbation::kLeft;
}

// [J_i J_j], 15×30, at two states.
Eigen::Matrix<double, 15, 30> JacobianOf(const ImuPreintegrator& imu, const State& i,
                                         const State& j) {
  const Manifold* manifold = TurnsOnTheLeft(imu) ? static_cast<const Manifold*>(&kLeft) : &kRight;
  ImuFactorFamily family;
  family.Add(imu);
  const test::FactorValues values = test::EvaluateFactor(
      family,
      {{i.pose, i.speed_bias, j.pose, j.speed_bias}, {manifold, nullptr, manifold, nullptr}});
  Eigen::Matrix<double, 15, 30> J;
  int column = 0;
  for (const int s : {0, 1, 2, 3}) {
    const int size = s % 2 == 0 ? 6 : 9;
    J.middleCols(column, size) =
        Eigen::Map<const Eigen::Matrix<double, 15, Eigen::Dynamic, Eigen::RowMajor>>(
            values.jacobians[static_cast<std::size_t>(s)].data(), 15, size);
    column += size;
  }
  return J;
}

// Entry by entry, against the deviations.
void ExpectEqual(const Eigen::MatrixXd& actual, const Eigen::MatrixXd& expected, double tolerance) {
  for (int r = 0; r < expected.rows(); ++r) {
    for (int c = 0; c < expected.cols(); ++c) {
      EXPECT_NEAR(actual(r, c), expected(r, c),
                  tolerance * std::sqrt(expected(r, r) * expected(c, c)))
          << r << ", " << c;
    }
  }
}

// The prior on i and the factor, j's part of their covariance: (J of the factor is tested against
// numeric ones).
TEST(PropagateImu, CovarianceIsWhatThePriorAndTheFactorImply) {
  test::Random random(41);
  for (int number = 0; number < test::kNumConventions; number += 3) {
    ImuOptions options;
    options.conventions = test::NumberedConventions(number);
    options.noise = {0.01, 0.02, 0.01, 0.03};
    const State i = RandomState(random);
    const ImuPreintegrator imu = IntegratedAt(i, options, test::LivelySamples(random, 20, 0.01));
    const State j = Propagated(imu, i);
    const auto J = JacobianOf(imu, i, j);
    Eigen::MatrixXd H = J.transpose() * J;
    H.topLeftCorner<15, 15>() += i.P.inverse();
    ExpectEqual(j.P, H.inverse().bottomRightCorner<15, 15>(), 1e-8);
  }
}

TEST(PropagateImu, StepByStepIsInOneGo) {
  test::Random random(42);
  for (int number = 0; number < test::kNumConventions; number += 7) {
    ImuOptions options;
    options.conventions = test::NumberedConventions(number);
    options.conventions.bias_walks_while_integrating = true;
    State state = RandomState(random);
    const auto samples = test::LivelySamples(random, 12, 0.01);
    const State whole = Propagated(IntegratedAt(state, options, samples), state);
    for (std::size_t k = 1; k < samples.size(); ++k) {
      // Into the state itself.
      const ImuPreintegrator step = IntegratedAt(state, options, {samples[k - 1], samples[k]});
      ASSERT_TRUE(PropagateImu(step, state.pose.data(), state.speed_bias.data(), state.P.data(),
                               state.pose.data(), state.speed_bias.data(), state.P.data())
                      .ok());
    }
    for (std::size_t k = 0; k < 7; ++k) {
      EXPECT_NEAR(state.pose[k], whole.pose[k], 1e-13);
    }
    for (std::size_t k = 0; k < 9; ++k) {
      EXPECT_NEAR(state.speed_bias[k], whole.speed_bias[k], 1e-13);
    }
    ExpectEqual(state.P, whole.P, 1e-12);
  }
}

// A chain of states whose positions are measured, at the states themselves: the filter's covariance
// is the last state's part of the inverse of the whole chain's information.
TEST(PropagateImu, AKalmanFilterWithItHasTheCovarianceOfTheWholeChain) {
  constexpr int kStates = 8;
  constexpr double kSigma = 0.05;
  for (const ImuConventions& conventions :
       {ImuConventions(), ImuConventions::Vins(), ImuConventions::Okvis()}) {
    test::Random random(43);
    ImuOptions options;
    options.conventions = conventions;
    options.noise = {0.01, 0.05, 0.01, 0.03};
    State state = RandomState(random);
    Eigen::MatrixXd H = Eigen::MatrixXd::Zero(15 * kStates, 15 * kStates);
    H.topLeftCorner<15, 15>() = state.P.inverse();
    for (int k = 1; k < kStates; ++k) {
      const ImuPreintegrator imu =
          IntegratedAt(state, options, test::LivelySamples(random, 10, 0.02));
      const State next = Propagated(imu, state);
      const auto J = JacobianOf(imu, state, next);
      H.block<30, 30>(15 * (k - 1), 15 * (k - 1)) += J.transpose() * J;
      H.block<3, 3>(15 * k, 15 * k) += Eigen::Matrix3d::Identity() / (kSigma * kSigma);
      // The update with H = [I 0], which moves nothing: the position is where it is measured.
      const Eigen::Matrix3d S =
          next.P.topLeftCorner<3, 3>() + kSigma * kSigma * Eigen::Matrix3d::Identity();
      const Eigen::Matrix<double, 15, 3> K = next.P.leftCols<3>() * S.inverse();
      state = next;
      state.P = (next.P - K * S * K.transpose()).eval();
    }
    const Eigen::MatrixXd covariance = H.inverse();
    ExpectEqual(state.P, covariance.bottomRightCorner<15, 15>(), 1e-7);
  }
}

TEST(PropagateImu, RefusesBadInputAndWritesNothing) {
  test::Random random(44);
  const ImuPreintegrator imu = Integrated({}, test::LivelySamples(random, 5, 0.01));
  const State good = RandomState(random);
  State out;
  const auto expect_refused = [&](const char* word, const ImuPreintegrator& with,
                                  const State& from) {
    const State before = out;
    const Status status =
        PropagateImu(with, from.pose.data(), from.speed_bias.data(), from.P.data(), out.pose.data(),
                     out.speed_bias.data(), out.P.data());
    EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
    EXPECT_NE(status.message.find(word), std::string::npos) << status.message;
    EXPECT_EQ(out.pose, before.pose);
    EXPECT_EQ(out.speed_bias, before.speed_bias);
    EXPECT_EQ(out.P, before.P);
  };
  expect_refused("nothing was integrated", ImuPreintegrator(), good);
  State bad = good;
  bad.pose[2] = std::numeric_limits<double>::quiet_NaN();
  expect_refused("not finite", imu, bad);
  bad = good;
  bad.P(3, 4) = std::numeric_limits<double>::infinity();
  expect_refused("not finite", imu, bad);
  EXPECT_TRUE(PropagateImu(imu, good.pose.data(), good.speed_bias.data(), nullptr, out.pose.data(),
                           out.speed_bias.data(), nullptr)
                  .ok());
}

}  // namespace
}  // namespace inceres
