// Priors on the variables of an inertial state.
#include "inceres/factors/pose_prior.h"

#include <cmath>
#include <limits>
#include <vector>

#include <gtest/gtest.h>

#include "factors/numeric_jacobian.h"
#include "inceres/problem/manifolds.h"
#include "inceres/problem/rotation.h"

namespace inceres {
namespace {

using test::EvaluateFactor;
using test::FactorState;
using test::FactorValues;

const PoseManifold kRight;
const LeftPoseManifold kLeft;

// U of a random information matrix.
void RandomWeight(test::Random& random, int size, double* U) {
  const std::vector<double> G = random.Vector(static_cast<std::size_t>(size * size));
  std::vector<double> W(G.size());
  for (int r = 0; r < size; ++r) {
    for (int c = 0; c < size; ++c) {
      double sum = r == c ? 1.0 : 0.0;
      for (int k = 0; k < size; ++k) {
        sum +=
            G[static_cast<std::size_t>(size * k + r)] * G[static_cast<std::size_t>(size * k + c)];
      }
      W[static_cast<std::size_t>(size * r + c)] = sum;
    }
  }
  ASSERT_TRUE(SqrtInformation(W.data(), size, U));
}

struct PriorState {
  PosePriorFamily::Measurement measurement;
  std::vector<double> pose = std::vector<double>(7);
  double step[6];  // pose = prior ⊞ step
};

PriorState RandomPrior(test::Random& random, const Manifold& manifold, double angle) {
  PriorState state;
  RandomWeight(random, 6, state.measurement.sqrt_information);
  const std::vector<double> numbers = random.Vector(6);
  double turn[4];
  test::RandomRotation(random, random.Between(0.0, 3.1), state.measurement.pose + 3);
  test::RandomRotation(random, angle, turn);
  for (std::size_t k = 0; k < 3; ++k) {
    state.measurement.pose[k] = numbers[k];
    state.step[k] = numbers[3 + k];
  }
  LogQuaternion(turn, state.step + 3);
  EXPECT_TRUE(manifold.Plus(state.measurement.pose, state.step, state.pose.data()));
  return state;
}

TEST(PosePrior, ResidualIsTheWhitenedStepAndJacobiansAreNumericOnes) {
  test::Random random(51);
  for (int index = 0; index < 1000; ++index) {
    const bool left = index % 2 == 0;
    const Manifold& manifold = left ? static_cast<const Manifold&>(kLeft) : kRight;
    const double angle = index % 5 == 0 ? 0.0 : index % 5 == 1 ? 1e-9 : random.Between(0.0, 2.8);
    const PriorState s = RandomPrior(random, manifold, angle);
    PosePriorFamily family(left ? PosePriorFamily::Side::kLeft : PosePriorFamily::Side::kRight);
    family.Add(s.measurement);
    const FactorState state{{s.pose}, {&manifold}};
    const FactorValues values = EvaluateFactor(family, state);
    for (int r = 0; r < 6; ++r) {
      double expected = 0.0;
      for (int k = 0; k < 6; ++k) {
        expected += s.measurement.sqrt_information[6 * r + k] * s.step[k];
      }
      EXPECT_NEAR(values.residuals[static_cast<std::size_t>(r)], expected, 1e-12);
    }
    test::ExpectNumericJacobians(family, state, 1e-7, index);
  }
}

TEST(PosePrior, FailsOnNonFiniteValues) {
  PosePriorFamily family;
  PosePriorFamily::Measurement measurement;
  measurement.sqrt_information[0] = 1.0;
  family.Add(measurement);
  FactorState state{{{0, 0, 0, 0, 0, 0, 1}}, {&kRight}};
  EXPECT_FALSE(EvaluateFactor(family, state).failure.failed());
  state.parameters[0][0] = std::numeric_limits<double>::infinity();
  EXPECT_STREQ(EvaluateFactor(family, state).failure.reason, "a residual is not finite");
}

TEST(SpeedBiasPrior, IsLinear) {
  test::Random random(52);
  SpeedBiasPriorFamily::Measurement measurement;
  RandomWeight(random, 9, measurement.sqrt_information);
  const std::vector<double> x = random.Vector(9);
  for (std::size_t k = 0; k < 9; ++k) {
    measurement.speed_bias[k] = random.Unit();
  }
  SpeedBiasPriorFamily family;
  family.Add(measurement);
  FactorState state{{x}, {nullptr}};
  const FactorValues values = EvaluateFactor(family, state);
  for (std::size_t r = 0; r < 9; ++r) {
    double expected = 0.0;
    for (std::size_t k = 0; k < 9; ++k) {
      expected += measurement.sqrt_information[9 * r + k] * (x[k] - measurement.speed_bias[k]);
    }
    EXPECT_NEAR(values.residuals[r], expected, 1e-14);
  }
  test::ExpectNumericJacobians(family, state, 1e-9, 0);
  state.parameters[0][4] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_STREQ(EvaluateFactor(family, state).failure.reason, "a residual is not finite");
}

// Residual and Jacobian read the same of it.
TEST(SpeedBiasPrior, ReadsTheUpperTriangleAlone) {
  test::Random random(53);
  SpeedBiasPriorFamily::Measurement measurement;
  RandomWeight(random, 9, measurement.sqrt_information);
  for (int r = 0; r < 9; ++r) {
    for (int c = 0; c < r; ++c) {
      measurement.sqrt_information[9 * r + c] = 7.0;
    }
  }
  SpeedBiasPriorFamily family;
  family.Add(measurement);
  const FactorState state{{random.Vector(9)}, {nullptr}};
  test::ExpectNumericJacobians(family, state, 1e-9, 0);
}

}  // namespace
}  // namespace inceres
