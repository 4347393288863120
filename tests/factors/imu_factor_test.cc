// The factor of a preintegrated measurement: numeric Jacobians in every convention, the formulas of
// the estimators whose conventions these are, and what leaves no residual.
#include "inceres/factors/imu_factor.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include <gtest/gtest.h>

#include "factors/imu_support.h"
#include "factors/numeric_jacobian.h"
#include "inceres/problem/manifolds.h"

namespace inceres {
namespace {

using test::EvaluateFactor;
using test::FactorState;
using test::FactorValues;
using test::Integrated;
using test::Matrix3d;
using test::Quaterniond;
using test::ToQuaternion;
using test::ToVector;
using test::Vector3d;
using Vector15d = Eigen::Matrix<double, 15, 1>;

const PoseManifold kRight;
const LeftPoseManifold kLeft;

ImuOptions WithConventions(const ImuConventions& conventions) {
  ImuOptions options;
  options.conventions = conventions;
  return options;
}

// Two states far from agreeing; the rotation residual is of this angle.
FactorState RandomState(test::Random& random, const ImuPreintegrator& imu, double angle) {
  const bool left = imu.options().conventions.perturbation == ImuConventions::Perturbation::kLeft;
  const Manifold* manifold = left ? static_cast<const Manifold*>(&kLeft) : &kRight;
  FactorState state{{random.Vector(7), random.Vector(9), random.Vector(7), random.Vector(9)},
                    {manifold, nullptr, manifold, nullptr}};
  for (const std::size_t s : {1, 3}) {
    for (std::size_t k = 3; k < 9; ++k) {
      state.parameters[s][k] *= 0.02;
    }
  }
  double error[4], moved[4];
  test::RandomRotation(random, random.Between(0.0, 3.1), state.parameters[0].data() + 3);
  test::RandomRotation(random, angle, error);
  MultiplyQuaternions(state.parameters[0].data() + 3, imu.delta().q, moved);
  MultiplyQuaternions(moved, error, state.parameters[2].data() + 3);
  return state;
}

TEST(ImuFactor, JacobiansInEveryConvention) {
  test::Random random(21);
  const double angles[4] = {0.0, 1e-9, 0.1, 2.5};
  for (int number = 0; number < test::kNumConventions; ++number) {
    const ImuOptions options = WithConventions(test::NumberedConventions(number));
    for (const int repeat : {0, 1}) {
      const double biases[6] = {0.02 * random.Unit(), 0.01, -0.02, 0.05 * random.Unit(), 0.02, 0.0};
      const auto samples = test::LivelySamples(random, 3 + random.Below(30), 0.01);
      const ImuPreintegrator imu = Integrated(options, samples, biases, biases + 3);
      ImuFactorFamily family;
      family.Add(imu);
      const double angle = repeat == 0 ? angles[number % 4] : random.Between(0.0, 2.8);
      test::ExpectNumericJacobians(family, RandomState(random, imu, angle),
                                   angle > 2.4 ? 1e-6 : 1e-8, number);
    }
  }
}

// U of the measurement, which whitens what the estimators' formulas say.
Vector15d Whitened(const ImuPreintegrator& imu, const Vector15d& r) {
  test::Matrix15d U;
  EXPECT_TRUE(imu.SqrtInformation(U.data()).ok());
  return U * r;
}

void ExpectResidual(const ImuPreintegrator& imu, const FactorState& state,
                    const Vector15d& expected) {
  ImuFactorFamily family;
  family.Add(imu);
  const FactorValues values = EvaluateFactor(family, state);
  ASSERT_FALSE(values.failure.failed()) << values.failure.reason;
  const Vector15d whitened = Whitened(imu, expected);
  for (int r = 0; r < 15; ++r) {
    EXPECT_NEAR(values.residuals[static_cast<std::size_t>(r)], whitened[r], 1e-10 * whitened.norm())
        << "row " << r;
  }
}

// The states of a factor and its measurement, corrected for the biases to first order; acc_column:
// of b_a in the speed-bias.
struct Reading {
  Reading(const ImuPreintegrator& imu, const FactorState& state, int gyr_column, int acc_column) {
    const auto& x = state.parameters;
    dt = imu.delta().dt;
    p_i = ToVector(x[0].data()), p_j = ToVector(x[2].data());
    q_i = ToQuaternion(x[0].data() + 3), q_j = ToQuaternion(x[2].data() + 3);
    v_i = ToVector(x[1].data()), v_j = ToVector(x[3].data());
    bg_i = ToVector(x[1].data() + gyr_column), bg_j = ToVector(x[3].data() + gyr_column);
    ba_i = ToVector(x[1].data() + acc_column), ba_j = ToVector(x[3].data() + acc_column);
    const Eigen::Map<const Eigen::Matrix<double, 9, 6, Eigen::RowMajor>> J(
        imu.delta().bias_jacobian);
    Eigen::Matrix<double, 6, 1> change;
    change << bg_i - ToVector(imu.delta().gyr_bias), ba_i - ToVector(imu.delta().acc_bias);
    const Eigen::Matrix<double, 9, 1> correction = J * change;
    dq = ToQuaternion(imu.delta().q) * test::Exp(correction.head<3>());
    dv = ToVector(imu.delta().v) + correction.segment<3>(3);
    dp = ToVector(imu.delta().p) + correction.tail<3>();
  }
  double dt;
  Vector3d p_i, p_j, v_i, v_j, bg_i, bg_j, ba_i, ba_j, dv, dp;
  Quaterniond q_i, q_j, dq;
};

// As VINS-Mono's IntegrationBase::evaluate states it, with G = (0, 0, g).
TEST(ImuFactor, SpeaksVins) {
  test::Random random(22);
  const ImuPreintegrator imu =
      Integrated(WithConventions(ImuConventions::Vins(9.8)), test::LivelySamples(random, 20, 0.01));
  const FactorState state = RandomState(random, imu, 0.4);
  const Reading m(imu, state, /*gyr_column=*/6, /*acc_column=*/3);
  const Vector3d G(0.0, 0.0, 9.8);
  const Quaterniond back = m.q_i.conjugate();
  Vector15d r;
  r << back * (0.5 * G * m.dt * m.dt + m.p_j - m.p_i - m.v_i * m.dt) - m.dp,
      2.0 * (m.dq.conjugate() * (back * m.q_j)).vec(), back * (G * m.dt + m.v_j - m.v_i) - m.dv,
      m.ba_j - m.ba_i, m.bg_j - m.bg_i;
  ASSERT_GT((m.dq.conjugate() * back * m.q_j).w(), 0.0);
  ExpectResidual(imu, state, r);
}

// As OKVIS's ImuError states it, measured minus states, with g_W = (0, 0, g).
TEST(ImuFactor, SpeaksOkvis) {
  test::Random random(23);
  const ImuPreintegrator imu = Integrated(WithConventions(ImuConventions::Okvis(9.8)),
                                          test::LivelySamples(random, 20, 0.01));
  const FactorState state = RandomState(random, imu, 0.4);
  const Reading m(imu, state, /*gyr_column=*/3, /*acc_column=*/6);
  const Vector3d g_W(0.0, 0.0, 9.8);
  const Matrix3d C_S0_W = m.q_i.conjugate().toRotationMatrix();
  Vector15d r;
  r << C_S0_W * (m.p_i - m.p_j + m.v_i * m.dt - 0.5 * g_W * m.dt * m.dt) + m.dp,
      2.0 * (m.dq * m.q_j.conjugate() * m.q_i).vec(), C_S0_W * (m.v_i - m.v_j - g_W * m.dt) + m.dv,
      m.bg_i - m.bg_j, m.ba_i - m.ba_j;
  ASSERT_GT((m.dq * m.q_j.conjugate() * m.q_i).w(), 0.0);
  ExpectResidual(imu, state, r);
}

// As XRSLAM's CeresPreIntegrationErrorFactor states it.
TEST(ImuFactor, SpeaksXrslam) {
  test::Random random(24);
  const ImuPreintegrator imu =
      Integrated(WithConventions(ImuConventions::Xrslam()), test::LivelySamples(random, 20, 0.01));
  const FactorState state = RandomState(random, imu, 0.4);
  const Reading m(imu, state, /*gyr_column=*/3, /*acc_column=*/6);
  const Vector3d g(0.0, 0.0, -9.80665);
  const Quaterniond back = m.q_i.conjugate();
  Vector15d r;
  r << test::Log(m.dq.conjugate() * back * m.q_j),
      back * (m.p_j - m.p_i - m.dt * m.v_i - 0.5 * m.dt * m.dt * g) - m.dp,
      back * (m.v_j - m.v_i - m.dt * g) - m.dv, m.bg_j - m.bg_i, m.ba_j - m.ba_i;
  ExpectResidual(imu, state, r);
}

// Order, frame and sign are words, not content: with the rotation vector the cost is the same in
// all of them.
TEST(ImuFactor, TheCostDoesNotDependOnWords) {
  test::Random random(25);
  const auto samples = test::LivelySamples(random, 25, 0.01);
  double expected = -1.0;
  for (int number = 0; number < test::kNumConventions; ++number) {
    ImuConventions conventions = test::NumberedConventions(number);
    conventions.rotation_residual = ImuConventions::RotationResidual::kLog;
    conventions.integration = ImuConventions::Integration::kMidpoint;
    conventions.noise = ImuConventions::Noise::kContinuous;
    conventions.bias_walks_while_integrating = true;
    conventions.gravity[2] = -9.81;
    const ImuPreintegrator imu = Integrated(WithConventions(conventions), samples);
    test::Random same(26);
    FactorState state = RandomState(same, imu, 0.8);
    const bool gyr_first = conventions.bias_order == ImuConventions::BiasOrder::kGyrFirst;
    for (const std::size_t s : {1, 3}) {
      auto& biases = state.parameters[s];
      std::fill_n(biases.begin() + (gyr_first ? 3 : 6), 3,
                  s == 1 ? 0.0 : 0.01);  // measured at this gyroscope bias
      std::fill_n(biases.begin() + (gyr_first ? 6 : 3), 3, s == 1 ? 0.02 : 0.03);
    }
    ImuFactorFamily family;
    family.Add(imu);
    double cost = 0.0;
    for (const double r : EvaluateFactor(family, state).residuals) {
      cost += r * r;
    }
    expected = expected < 0.0 ? cost : expected;
    EXPECT_NEAR(cost, expected, 1e-10 * expected) << "conventions " << number;
  }
}

TEST(ImuFactor, PropagatedStatesLeaveNoResidual) {
  test::Random random(27);
  for (int number = 0; number < test::kNumConventions; number += 5) {
    const ImuPreintegrator imu = Integrated(WithConventions(test::NumberedConventions(number)),
                                            test::LivelySamples(random, 20, 0.01));
    FactorState state = RandomState(random, imu, 0.0);
    const Status status =
        PropagateImu(imu, state.parameters[0].data(), state.parameters[1].data(), nullptr,
                     state.parameters[2].data(), state.parameters[3].data(), nullptr);
    ASSERT_TRUE(status.ok()) << status.message;
    ImuFactorFamily family;
    family.Add(imu);
    for (const double r : EvaluateFactor(family, state).residuals) {
      EXPECT_NEAR(r, 0.0, 1e-8) << "conventions " << number;
    }
  }
}

TEST(ImuFactor, RecentersAtTheBiasesOfItsFirstState) {
  test::Random random(28);
  for (const ImuConventions& conventions : {ImuConventions::Vins(), ImuConventions::Okvis()}) {
    const auto samples = test::LivelySamples(random, 40, 0.01);
    const ImuPreintegrator imu = Integrated(WithConventions(conventions), samples);
    ImuFactorFamily family;
    family.Add(imu);
    FactorState state = RandomState(random, imu, 0.1);
    std::vector<const double*> parameters;
    for (const auto& values : state.parameters) {
      parameters.push_back(values.data());
    }
    const FactorValues before = EvaluateFactor(family, state);
    ASSERT_TRUE(family.Recenters());
    EXPECT_TRUE(family.Recenter(0, parameters.data()));
    EXPECT_FALSE(family.Recenter(0, parameters.data())) << "is there already";
    const bool gyr_first = conventions.bias_order == ImuConventions::BiasOrder::kGyrFirst;
    const ImuPreintegrator fresh =
        Integrated(WithConventions(conventions), samples, parameters[1] + (gyr_first ? 3 : 6),
                   parameters[1] + (gyr_first ? 6 : 3));
    EXPECT_EQ(test::Difference(fresh.delta(), family.measurement(0).delta()).norm(), 0.0);
    ImuFactorFamily expected;
    expected.Add(fresh);
    EXPECT_EQ(EvaluateFactor(family, state).residuals, EvaluateFactor(expected, state).residuals);
    EXPECT_NE(EvaluateFactor(family, state).residuals, before.residuals);
  }
}

TEST(ImuFactor, FailsWithoutInformationAndOnNonFiniteValues) {
  test::Random random(29);
  const ImuPreintegrator imu = Integrated({}, test::LivelySamples(random, 10, 0.01));
  FactorState state = RandomState(random, imu, 0.1);
  ImuFactorFamily blank;
  blank.Add(ImuPreintegrator());
  EXPECT_STREQ(EvaluateFactor(blank, state).failure.reason,
               "the preintegration has no information matrix: too few samples, or none");
  ImuFactorFamily family;
  family.Add(imu);
  state.parameters[3][1] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_STREQ(EvaluateFactor(family, state).failure.reason, "a residual is not finite");
  EXPECT_EQ(EvaluateFactor(family, state).failure.factor, 0);
}

}  // namespace
}  // namespace inceres
