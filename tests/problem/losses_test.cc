#include "inceres/problem/losses.h"

#include <cmath>
#include <ostream>
#include <string>

#include <gtest/gtest.h>

namespace inceres {
namespace {

struct LossCase {
  std::string name;
  std::shared_ptr<const Loss> loss;
  double kink;  // the s where the third derivative jumps, or negative
};

// What GoogleTest and CTest call the instance.
void PrintTo(const LossCase& loss_case, std::ostream* stream) {
  *stream << loss_case.name;
}

std::vector<LossCase> AllLosses() {
  const auto huber = std::make_shared<HuberLoss>(1.3);
  const auto cauchy = std::make_shared<CauchyLoss>(0.7);
  return {{"Huber", huber, 1.3 * 1.3},
          {"SoftLOne", std::make_shared<SoftLOneLoss>(0.4), -1.0},
          {"Cauchy", cauchy, -1.0},
          {"Arctan", std::make_shared<ArctanLoss>(2.0), -1.0},
          {"Tolerant", std::make_shared<TolerantLoss>(3.0, 0.5), -1.0},
          {"Tukey", std::make_shared<TukeyLoss>(1.5), 1.5 * 1.5},
          {"Scaled", std::make_shared<ScaledLoss>(cauchy, 2.5), -1.0},
          {"ScaledIdentity", std::make_shared<ScaledLoss>(nullptr, 2.5), -1.0},
          {"Composed", std::make_shared<ComposedLoss>(cauchy, std::make_shared<SoftLOneLoss>(0.9)),
           -1.0},
          {"ComposedWithIdentity", std::make_shared<ComposedLoss>(nullptr, cauchy), -1.0}};
}

class LossLaws : public testing::TestWithParam<LossCase> {
 protected:
  double Value(double s) const {
    double rho[3];
    GetParam().loss->Evaluate(s, rho);
    return rho[0];
  }
};

TEST_P(LossLaws, ZeroCostsNothing) {
  EXPECT_NEAR(Value(0.0), 0.0, 1e-15);
}

TEST_P(LossLaws, DerivativesAgreeWithDifferences) {
  for (double s = 0.01; s < 20.0; s *= 1.13) {
    const double step = 1e-4 * s;
    if (std::fabs(s - GetParam().kink) < 2.0 * step) {
      continue;
    }
    double rho[3];
    GetParam().loss->Evaluate(s, rho);
    const double first = (Value(s + step) - Value(s - step)) / (2.0 * step);
    const double second = (Value(s + step) - 2.0 * Value(s) + Value(s - step)) / (step * step);
    EXPECT_NEAR(rho[1], first, 1e-7) << "s = " << s;
    EXPECT_NEAR(rho[2], second, 1e-5 + 1e-13 / (step * step)) << "s = " << s;
  }
}

TEST_P(LossLaws, NeverDecreases) {
  double previous = -1e-15;
  for (double s = 0.0; s < 50.0; s += 0.01) {
    const double value = Value(s);
    EXPECT_GE(value, previous - 1e-14) << "s = " << s;
    previous = value;
  }
}

TEST_P(LossLaws, HugeResidualsStayFinite) {
  for (const double s : {1e10, 1e100, 1e300}) {
    double rho[3];
    GetParam().loss->Evaluate(s, rho);
    for (const double value : rho) {
      EXPECT_TRUE(std::isfinite(value)) << "s = " << s;
    }
    EXPECT_GE(rho[1], 0.0);
  }
}

INSTANTIATE_TEST_SUITE_P(BuiltIn, LossLaws, testing::ValuesIn(AllLosses()),
                         [](const testing::TestParamInfo<LossCase>& instance) {
                           return instance.param.name;
                         });

TEST(Losses, KnownValues) {
  double rho[3];
  HuberLoss(2.0).Evaluate(9.0, rho);
  EXPECT_DOUBLE_EQ(rho[0], 2.0 * 2.0 * 3.0 - 4.0);
  EXPECT_DOUBLE_EQ(rho[1], 2.0 / 3.0);
  CauchyLoss(1.0).Evaluate(1.0, rho);
  EXPECT_DOUBLE_EQ(rho[0], std::log(2.0));
  TukeyLoss(1.0).Evaluate(5.0, rho);
  EXPECT_DOUBLE_EQ(rho[0], 1.0 / 3.0);
  EXPECT_EQ(rho[1], 0.0);
  SoftLOneLoss(1.0).Evaluate(3.0, rho);
  EXPECT_DOUBLE_EQ(rho[0], 2.0);
  ArctanLoss(1.0).Evaluate(1.0, rho);
  EXPECT_DOUBLE_EQ(rho[0], M_PI / 4.0);
  TolerantLoss(10.0, 0.1).Evaluate(15.0, rho);
  EXPECT_DOUBLE_EQ(rho[0], 5.0);
}

}  // namespace
}  // namespace inceres
