// The correction for a loss against the matrices of Triggs, and the two edge cases: s = 0 and ρ'' >
// 0.
#include "linearize/robustify.h"

#include <cmath>
#include <limits>
#include <memory>

#include <Eigen/Core>
#include <gtest/gtest.h>

#include "inceres/problem/losses.h"
#include "support/random_values.h"

namespace inceres::internal {
namespace {

constexpr int kRows = 3;
constexpr int kStride = 8;
using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// ρ(s) = s + s²: ρ'' = 2 > 0 everywhere.
class ConvexLoss final : public Loss {
 public:
  void Evaluate(double s, double rho[3]) const override {
    rho[0] = s + s * s;
    rho[1] = 1.0 + 2.0 * s;
    rho[2] = 2.0;
  }
};

// Two slots of sizes 6 and 3 (the second a constant), two factors; the correction is for factor 1.
struct Case {
  explicit Case(double scale) {
    test::Random random(3);
    J = {random.Vector(2 * kRows * kStride), random.Vector(2 * kRows * 4)};
    for (int k = 0; k < 2; ++k) {
      const int stride = k == 0 ? kStride : 4;
      const int size = k == 0 ? 6 : 3;
      for (std::size_t at = 0; at < J[static_cast<std::size_t>(k)].size(); ++at) {
        if (static_cast<int>(at) % stride >= size) {
          J[static_cast<std::size_t>(k)][at] = 0.0;
        }
      }
    }
    f = {scale * 0.3, scale * -0.7, scale * 0.2};
  }

  double Correct(const Loss& loss, LossCurvature curvature = LossCurvature::kPositive) {
    const SlotJacobians slots[2] = {{J[0].data(), kRows * kStride, kStride, 6},
                                    {J[1].data(), kRows * 4, 4, 3}};
    const std::int32_t offsets[2] = {7, -1};
    const LossValue value(&loss, f.data(), kRows);
    RobustifyFactor(value, kRows, 2, slots, 1, offsets, curvature, f.data());
    return value.cost();
  }

  Matrix FirstSlot() const {
    return Eigen::Map<const Matrix>(J[0].data() + kRows * kStride, kRows, kStride);
  }
  Eigen::Vector3d Residual() const { return Eigen::Vector3d(f[0], f[1], f[2]); }

  std::vector<std::vector<double>> J;
  std::vector<double> f;
};

class Robustify : public testing::TestWithParam<double> {};

TEST_P(Robustify, GradientAndHessianAreThoseOfTheRobustCost) {
  const std::shared_ptr<const Loss> losses[] = {
      std::make_shared<HuberLoss>(0.4),          std::make_shared<CauchyLoss>(0.5),
      std::make_shared<SoftLOneLoss>(0.3),       std::make_shared<ArctanLoss>(0.7),
      std::make_shared<TolerantLoss>(0.5, 0.2),  std::make_shared<ConvexLoss>(),
      std::make_shared<ScaledLoss>(nullptr, 4.0)};
  for (const auto& loss : losses) {
    const Case before(GetParam());
    Case after(GetParam());
    const double cost = after.Correct(*loss);
    double rho[3];
    const Eigen::Vector3d f = before.Residual();
    loss->Evaluate(f.squaredNorm(), rho);
    EXPECT_EQ(cost, 0.5 * rho[0]);
    // ∇ ½ρ(‖f‖²) = ρ' Jᵀf
    const Matrix J = before.FirstSlot();
    const Eigen::VectorXd g = after.FirstSlot().transpose() * after.Residual();
    EXPECT_LT((g - rho[1] * J.transpose() * f).norm(), 1e-14 * (1.0 + g.norm()));
    // JᵀJ becomes Jᵀ (ρ' I + 2ρ'' f fᵀ) J where ρ'' > 0, else ρ' JᵀJ.
    Matrix weight = rho[1] * Matrix::Identity(kRows, kRows);
    if (rho[2] > 0.0) {
      weight += 2.0 * rho[2] * f * f.transpose();
    }
    const Matrix H = after.FirstSlot().transpose() * after.FirstSlot();
    const Matrix H_expected = J.transpose() * weight * J;
    EXPECT_LT((H - H_expected).norm(), 1e-13 * (1.0 + H_expected.norm()));
  }
}

INSTANTIATE_TEST_SUITE_P(Scales, Robustify, testing::Values(0.1, 1.0, 3.0));

// The correction for ρ'' > 0, entry by entry: f := √ρ'/(1−α) f, J := √ρ' (I − α/s f fᵀ) J with the
// f of before.
TEST(RobustifyFactor, SecondOrderFormula) {
  const Case before(1.0);
  Case after(1.0);
  after.Correct(ConvexLoss());
  const Eigen::Vector3d f = before.Residual();
  const double s = f.squaredNorm();
  const double rho1 = 1.0 + 2.0 * s;
  const double alpha = 1.0 - std::sqrt(1.0 + 2.0 * s * 2.0 / rho1);
  ASSERT_LT(alpha, 0.0);
  EXPECT_LT((after.Residual() - std::sqrt(rho1) / (1.0 - alpha) * f).norm(), 1e-15);
  const Matrix projector = Matrix::Identity(kRows, kRows) - alpha / s * f * f.transpose();
  EXPECT_LT((after.FirstSlot() - std::sqrt(rho1) * projector * before.FirstSlot()).norm(), 1e-14);
}

// With ρ'' < 0 the gradient stays, and of the curvature along f the share 1 + 2 s ρ''/ρ' is left,
// or half.
TEST(RobustifyFactor, CurvatureIsReducedDownToHalf) {
  for (const double size : {0.3, 3.0}) {
    const CauchyLoss loss(1.0);
    const Case before(size);
    Case plain(size);
    Case reduced(size);
    const double cost = plain.Correct(loss);
    EXPECT_EQ(reduced.Correct(loss, LossCurvature::kBoth), cost);
    const Eigen::Vector3d f = before.Residual();
    const double s = f.squaredNorm();
    const Eigen::VectorXd g = plain.FirstSlot().transpose() * plain.Residual();
    EXPECT_LT((reduced.FirstSlot().transpose() * reduced.Residual() - g).norm(),
              1e-13 * (1.0 + g.norm()));
    const double rho1 = 1.0 / (1.0 + s);
    const double share = std::max(0.5, 1.0 - 2.0 * s * rho1);  // ρ'' = −ρ'²
    EXPECT_EQ(share == 0.5, size == 3.0);
    const Matrix weight =
        rho1 * (Matrix::Identity(kRows, kRows) - (1.0 - share) / s * f * f.transpose());
    const Matrix expected = before.FirstSlot().transpose() * weight * before.FirstSlot();
    EXPECT_LT((reduced.FirstSlot().transpose() * reduced.FirstSlot() - expected).norm(),
              1e-13 * (1.0 + expected.norm()));
  }
}

TEST(RobustifyFactor, ZeroResidualScalesTheJacobianOnly) {
  Case after(0.0);
  EXPECT_EQ(after.Correct(ScaledLoss(std::make_shared<ConvexLoss>(), 9.0)), 0.0);
  EXPECT_EQ(after.Residual(), Eigen::Vector3d::Zero());
  EXPECT_LT((after.FirstSlot() - 3.0 * Case(0.0).FirstSlot()).norm(), 1e-15);
}

TEST(RobustifyFactor, OtherFactorsConstantsAndPaddingStayAsTheyWere) {
  const Case before(1.0);
  Case after(1.0);
  after.Correct(ConvexLoss());
  EXPECT_EQ(after.J[1], before.J[1]);
  EXPECT_TRUE(
      std::equal(before.J[0].begin(), before.J[0].begin() + kRows * kStride, after.J[0].begin()));
  EXPECT_NE(after.J[0], before.J[0]);
  EXPECT_EQ(after.FirstSlot().rightCols(2), Matrix::Zero(kRows, 2));
}

// Nobody writes the padding again: what a broken loss leaves there would stay.
TEST(RobustifyFactor, ALossThatGivesNaNDoesNotReachThePadding) {
  Case after(1.0);
  after.Correct(ScaledLoss(nullptr, std::numeric_limits<double>::quiet_NaN()));
  EXPECT_TRUE(std::isnan(after.FirstSlot()(0, 0)));
  EXPECT_EQ(after.FirstSlot().rightCols(2), Matrix::Zero(kRows, 2));
}

// Inside the quadratic part of Huber's loss nothing may change, not even the last bit.
TEST(RobustifyFactor, ALossThatDoesNothingChangesNothing) {
  const Case before(1.0);
  Case after(1.0);
  after.Correct(HuberLoss(10.0));
  EXPECT_EQ(after.J, before.J);
  EXPECT_EQ(after.f, before.f);
}

TEST(RobustifyFactor, WithoutALossTheCostIsHalfTheSquaredNorm) {
  const double f[3] = {1.0, -2.0, 3.0};
  EXPECT_EQ(LossValue(nullptr, f, 3).cost(), 7.0);
}

}  // namespace
}  // namespace inceres::internal
