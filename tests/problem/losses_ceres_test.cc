// The losses are those of Ceres, at random s.
#include <cmath>
#include <random>

#include <ceres/loss_function.h>
#include <gtest/gtest.h>

#include "inceres/problem/losses.h"

namespace inceres {
namespace {

void ExpectSame(const char* name, const Loss& ours, const ceres::LossFunction& theirs) {
  SCOPED_TRACE(name);
  std::mt19937_64 random(11);
  std::uniform_real_distribution<double> exponent(-6.0, 5.0);
  for (int k = 0; k < 2000; ++k) {
    const double s = k == 0 ? 0.0 : std::pow(10.0, exponent(random));
    double rho[3];
    double expected[3];
    ours.Evaluate(s, rho);
    theirs.Evaluate(s, expected);
    for (int order = 0; order < 3; ++order) {
      ASSERT_NEAR(rho[order], expected[order], 1e-14 * (1.0 + std::fabs(expected[order])))
          << "s = " << s << ", order " << order;
    }
  }
}

TEST(LossesAgainstCeres, Agree) {
  ExpectSame("Huber", HuberLoss(1.7), ceres::HuberLoss(1.7));
  ExpectSame("SoftLOne", SoftLOneLoss(1.7), ceres::SoftLOneLoss(1.7));
  ExpectSame("Cauchy", CauchyLoss(1.7), ceres::CauchyLoss(1.7));
  ExpectSame("Arctan", ArctanLoss(1.7), ceres::ArctanLoss(1.7));
  ExpectSame("Tukey", TukeyLoss(1.7), ceres::TukeyLoss(1.7));
  ExpectSame("Tolerant", TolerantLoss(5.0, 0.7), ceres::TolerantLoss(5.0, 0.7));
  ExpectSame("Scaled", ScaledLoss(std::make_shared<HuberLoss>(1.7), 3.0),
             ceres::ScaledLoss(new ceres::HuberLoss(1.7), 3.0, ceres::TAKE_OWNERSHIP));
  ExpectSame("Scaled identity", ScaledLoss(nullptr, 3.0),
             ceres::ScaledLoss(nullptr, 3.0, ceres::TAKE_OWNERSHIP));
  ExpectSame("Composed",
             ComposedLoss(std::make_shared<CauchyLoss>(1.7), std::make_shared<HuberLoss>(2.0)),
             ceres::ComposedLoss(new ceres::CauchyLoss(1.7), ceres::TAKE_OWNERSHIP,
                                 new ceres::HuberLoss(2.0), ceres::TAKE_OWNERSHIP));
}

}  // namespace
}  // namespace inceres
