// inceres::Covariance judges the rank as ceres::Covariance does.
#include <algorithm>
#include <array>
#include <cmath>
#include <deque>

#include <Eigen/Core>
#include <ceres/covariance.h>
#include <ceres/problem.h>
#include <gtest/gtest.h>

#include "inceres/ceres/covariance.h"
#include "support/ceres_lambdas.h"
#include "support/random_values.h"

namespace inceres::test {
namespace {

using Eigen::MatrixXd;

constexpr int kPoint = 3;

MatrixXd RandomRows(Random* random, int rows, int columns) {
  return MatrixXd::NullaryExpr(rows, columns, [random] { return random->Unit(); });
}

// f(x) = A x, of which only A matters.
struct LinearProblem {
  double* AddBlock(int size) { return blocks.emplace_back(static_cast<std::size_t>(size)).data(); }
  void AddResidual(const std::vector<double*>& ids, const std::vector<MatrixXd>& A) {
    std::vector<int> sizes;
    for (const MatrixXd& block : A) {
      sizes.push_back(static_cast<int>(block.cols()));
    }
    const auto rows = static_cast<int>(A[0].rows());
    problem.AddResidualBlock(
        new lambdas::Formula(
            rows, sizes,
            [=](double const* const*, double* residuals, double** jacobians) {
              using RowMajor =
                  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
              std::fill_n(residuals, rows, 0.0);
              for (std::size_t k = 0; k < A.size(); ++k) {
                Eigen::Map<RowMajor>(jacobians[k], rows, sizes[k]) = A[k];
              }
              return true;
            }),
        nullptr, ids);
  }

  std::deque<std::vector<double>> blocks;
  ceres::Problem problem;
};

// As many rows for each point as it has coordinates, which it uses up.
double* AddFrameWithOwnPoints(int size, int num_points, double stiff, Random* random,
                              LinearProblem* linear) {
  double* frame = linear->AddBlock(size);
  for (int l = 0; l < num_points; ++l) {
    linear->AddResidual(
        {frame, linear->AddBlock(kPoint)},
        {stiff * RandomRows(random, kPoint, size), stiff * RandomRows(random, kPoint, kPoint)});
  }
  return frame;
}

void ExpectFalseInBoth(const double* block, LinearProblem* linear) {
  const std::vector<const double*> blocks = {block};
  ceres::Covariance stock{ceres::Covariance::Options()};
  EXPECT_FALSE(stock.Compute(blocks, &linear->problem));
  Covariance ours{ceres::Covariance::Options()};
  EXPECT_FALSE(ours.Compute(blocks, &linear->problem));
  EXPECT_FALSE(ours.report().used_stock);
  EXPECT_NE(ours.report().message.find("open, which move parameter block"), std::string::npos)
      << ours.report().message;
}

// What is left of S is rounding, which is positive as often as not.
TEST(RankOfACeresProblem, FramesThatTheirPointsUseUpAreFalse) {
  for (const auto& [size, num_points] : {std::pair(1, 3), {1, 100}, {2, 10}}) {
    for (unsigned seed = 0; seed < 25; ++seed) {
      SCOPED_TRACE(testing::Message() << size << " by " << num_points << ", seed " << seed);
      Random random(seed);
      LinearProblem linear;
      const double* frame = AddFrameWithOwnPoints(size, num_points, 1.0, &random, &linear);
      AddFrameWithOwnPoints(size, num_points, 1.0, &random, &linear);
      ExpectFalseInBoth(frame, &linear);
    }
  }
}

TEST(RankOfACeresProblem, AScalarThatAllPointsUseUpIsFalse) {
  for (unsigned seed = 0; seed < 50; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    LinearProblem linear;
    double *camera = linear.AddBlock(6), *scalar = linear.AddBlock(1);
    linear.AddResidual({camera}, {RandomRows(&random, 8, 6)});
    for (int l = 0; l < 50; ++l) {
      linear.AddResidual(
          {camera, scalar, linear.AddBlock(kPoint)},
          {RandomRows(&random, 3, 6), RandomRows(&random, 3, 1), RandomRows(&random, 3, kPoint)});
    }
    ExpectFalseInBoth(seed % 2 == 0 ? scalar : camera, &linear);
  }
}

// The points use up rows of weight 1e7, and one of weight 1 determines: all its digits are those of
// stock.
TEST(RankOfACeresProblem, AWeakPriorBesideStiffPointsIsTrue) {
  for (const double stiff : {1e2, 1e4, 1e7}) {
    for (unsigned seed = 0; seed < 10; ++seed) {
      SCOPED_TRACE(testing::Message() << stiff << ", seed " << seed);
      Random random(seed);
      LinearProblem linear;
      double* frame = AddFrameWithOwnPoints(2, 20, stiff, &random, &linear);
      linear.AddResidual({frame}, {RandomRows(&random, 4, 2)});
      const std::vector<const double*> blocks = {frame};
      ceres::Covariance stock{ceres::Covariance::Options()};
      ASSERT_TRUE(stock.Compute(blocks, &linear.problem));
      Covariance ours{ceres::Covariance::Options()};
      ASSERT_TRUE(ours.Compute(blocks, &linear.problem)) << ours.report().message;
      EXPECT_FALSE(ours.report().used_stock);
      double expected[4], actual[4];
      ASSERT_TRUE(stock.GetCovarianceBlock(frame, frame, expected));
      ASSERT_TRUE(ours.GetCovarianceBlock(frame, frame, actual));
      for (int k = 0; k < 4; ++k) {
        EXPECT_NEAR(actual[k], expected[k], 1e-6 * std::abs(expected[0])) << k;
      }
    }
  }
}

// Residual blocks without a variable are rows of zeros in Ceres's Jacobian: with them it may have
// more singular values, which are zero.
TEST(RankOfACeresProblem, DenseSvdCountsFixedResidualBlocks) {
  for (const int num_fixed : {0, 1, 2, 5}) {
    for (const int null_space_rank : {-1, 0, 1, 2, 3, 4}) {
      SCOPED_TRACE(testing::Message() << num_fixed << " fixed, rank " << null_space_rank);
      Random random(7);
      LinearProblem linear;
      double *x = linear.AddBlock(4), *held = linear.AddBlock(2);
      linear.AddResidual({x}, {RandomRows(&random, 2, 4)});
      for (int i = 0; i < num_fixed; ++i) {
        linear.AddResidual({held}, {RandomRows(&random, 1, 2)});
      }
      linear.problem.AddParameterBlock(held, 2);
      linear.problem.SetParameterBlockConstant(held);
      ceres::Covariance::Options options;
      options.algorithm_type = ceres::DENSE_SVD;
      options.null_space_rank = null_space_rank;
      const std::vector<const double*> blocks = {x};
      ceres::Covariance stock(options);
      const bool computed = stock.Compute(blocks, &linear.problem);
      Covariance ours(options);
      ASSERT_EQ(ours.Compute(blocks, &linear.problem), computed) << ours.report().message;
      EXPECT_FALSE(ours.report().used_stock);
      std::array<double, 16> expected{}, actual{};
      if (computed) {
        ASSERT_TRUE(stock.GetCovarianceBlock(x, x, expected.data()));
        ASSERT_TRUE(ours.GetCovarianceBlock(x, x, actual.data()));
      }
      for (std::size_t k = 0; k < expected.size(); ++k) {
        EXPECT_NEAR(actual[k], expected[k], 1e-11) << k;
      }
      // Of constants alone nothing has to have a rank.
      EXPECT_TRUE(ours.Compute(std::vector<const double*>{held}, &linear.problem));
    }
  }
}

}  // namespace
}  // namespace inceres::test
