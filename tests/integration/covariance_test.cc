// inceres::Covariance of a ceres::Problem next to ceres::Covariance.
#include "inceres/ceres/covariance.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>
#include <ceres/autodiff_cost_function.h>
#include <ceres/covariance.h>
#include <ceres/evaluation_callback.h>
#include <ceres/solver.h>
#include <gtest/gtest.h>

#include "integration/problems.h"
#include "support/ceres_lambdas.h"
#include "support/random_values.h"

namespace inceres::test {
namespace {

using Eigen::MatrixXd;
using Pairs = std::vector<std::pair<const double*, const double*>>;

std::vector<double*> BlocksOf(const ceres::Problem& problem) {
  std::vector<double*> blocks;
  problem.GetParameterBlocks(&blocks);
  std::sort(blocks.begin(), blocks.end());
  return blocks;
}

Pairs PairsOf(const ceres::Problem& problem, const std::vector<std::pair<int, int>>& indices) {
  const std::vector<double*> blocks = BlocksOf(problem);
  Pairs pairs;
  for (const auto& [a, b] : indices) {
    pairs.emplace_back(blocks[static_cast<std::size_t>(a)], blocks[static_cast<std::size_t>(b)]);
  }
  return pairs;
}

void Solve(ceres::Problem* problem) {
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.max_num_iterations = 50;
  ceres::Solver::Summary summary;
  ceres::Solve(options, problem, &summary);
  ASSERT_TRUE(summary.IsSolutionUsable());
}

void ExpectClose(const std::vector<double>& ours, const std::vector<double>& stock) {
  double largest = 0.0;
  for (const double entry : stock) {
    largest = std::max(largest, std::abs(entry));
  }
  for (std::size_t i = 0; i < stock.size(); ++i) {
    EXPECT_NEAR(ours[i], stock[i], 1e-7 * largest) << i;
  }
}

// Each pair, in both orders and both spaces.
void ExpectSameBlocks(const Covariance& ours, const ceres::Covariance& stock, const Pairs& pairs) {
  for (std::size_t k = 0; k < 2 * pairs.size(); ++k) {
    const auto& [first, second] = pairs[k / 2];
    const double* a = k % 2 == 0 ? first : second;
    const double* b = k % 2 == 0 ? second : first;
    SCOPED_TRACE(k);
    std::vector<double> expected(100, 7.0), actual(100, 7.0);
    ASSERT_TRUE(stock.GetCovarianceBlock(a, b, expected.data()));
    ASSERT_TRUE(ours.GetCovarianceBlock(a, b, actual.data()));
    ExpectClose(actual, expected);
    ASSERT_TRUE(stock.GetCovarianceBlockInTangentSpace(a, b, expected.data()));
    ASSERT_TRUE(ours.GetCovarianceBlockInTangentSpace(a, b, actual.data()));
    ExpectClose(actual, expected);
  }
}

void ExpectStock(std::unique_ptr<Instance> instance,
                 const std::vector<std::pair<int, int>>& indices) {
  Solve(instance->problem.get());
  const Pairs pairs = PairsOf(*instance->problem, indices);
  for (const bool apply_loss_function : {true, false}) {
    ceres::Covariance::Options options;
    options.apply_loss_function = apply_loss_function;
    ceres::Covariance stock(options);
    ASSERT_TRUE(stock.Compute(pairs, instance->problem.get()));
    Covariance ours(options);
    ASSERT_TRUE(ours.Compute(pairs, instance->problem.get())) << ours.report().message;
    EXPECT_FALSE(ours.report().used_stock) << ours.report().message;
    ExpectSameBlocks(ours, stock, pairs);
  }
}

// Poses first in memory, then the inverse depths; poses 0 and 1 are constant.
TEST(CovarianceOfACeresProblem, PosesOnAManifoldAndInverseDepths) {
  for (const PoseUpdate update : {PoseUpdate::kManifold, PoseUpdate::kLocalParameterization}) {
    ExpectStock(MakeInverseDepth(update, Huber(1.0)), {{2, 2},
                                                       {2, 3},
                                                       {11, 4},
                                                       {11, 11},
                                                       {20, 20},
                                                       {20, 2},
                                                       {5, 40},
                                                       {20, 21},
                                                       {20, 200},
                                                       {0, 20},
                                                       {1, 2}});
  }
}

TEST(CovarianceOfACeresProblem, CamerasAndPoints) {
  ExpectStock(MakeBal(SmallStreet(3, 1.0), tools::BalCameraModel::kAngleAxis,
                      Gauge::kTwoCamerasConstant, Huber(1.0)),
              {{2, 2}, {3, 2}, {7, 7}, {30, 30}, {30, 3}, {4, 31}, {30, 31}});
}

// All cameras and points at once: the blocks come from the factor of S.
TEST(CovarianceOfACeresProblem, EveryBlockOfAStreet) {
  const std::unique_ptr<Instance> instance =
      MakeBal(SmallStreet(4, 1.0), tools::BalCameraModel::kAngleAxis, Gauge::kTwoCamerasConstant,
              tools::LossSpec());
  Solve(instance->problem.get());
  Pairs pairs;
  for (const double* block : BlocksOf(*instance->problem)) {
    pairs.emplace_back(block, block);
  }
  ceres::Covariance stock{ceres::Covariance::Options()};
  ASSERT_TRUE(stock.Compute(pairs, instance->problem.get()));
  Covariance ours{ceres::Covariance::Options()};
  ASSERT_TRUE(ours.Compute(pairs, instance->problem.get()));
  EXPECT_FALSE(ours.report().used_stock);
  ExpectSameBlocks(ours, stock, pairs);
}

TEST(CovarianceOfACeresProblem, MatricesAreMadeOfBlocks) {
  const std::unique_ptr<Instance> instance =
      MakeInverseDepth(PoseUpdate::kManifold, tools::LossSpec());
  Solve(instance->problem.get());
  const std::vector<double*> all = BlocksOf(*instance->problem);
  const std::vector<const double*> blocks = {all[3], all[0], all[30], all[2]};
  ceres::Covariance stock{ceres::Covariance::Options()};
  ASSERT_TRUE(stock.Compute(blocks, instance->problem.get()));
  Covariance ours{ceres::Covariance::Options()};
  ASSERT_TRUE(ours.Compute(blocks, instance->problem.get()));
  std::vector<double> expected(22 * 22), actual(22 * 22);
  ASSERT_TRUE(stock.GetCovarianceMatrix(blocks, expected.data()));
  ASSERT_TRUE(ours.GetCovarianceMatrix(blocks, actual.data()));
  ExpectClose(actual, expected);
  ASSERT_TRUE(stock.GetCovarianceMatrixInTangentSpace(blocks, expected.data()));
  ASSERT_TRUE(ours.GetCovarianceMatrixInTangentSpace(blocks, actual.data()));
  ExpectClose(actual, expected);
  EXPECT_FALSE(ours.GetCovarianceMatrix({all[3], all[4]}, actual.data())) << "never computed";
}

TEST(CovarianceOfACeresProblem, AFreeGaugeIsFalseInBothAndNamed) {
  const std::unique_ptr<Instance> instance =
      MakeBal(SmallStreet(3, 1.0), tools::BalCameraModel::kAngleAxis, Gauge::kFree, Huber(1.0));
  const Pairs pairs = {{instance->x.data(), instance->x.data()}};
  ceres::Covariance stock{ceres::Covariance::Options()};
  EXPECT_FALSE(stock.Compute(pairs, instance->problem.get()));
  Covariance ours{ceres::Covariance::Options()};
  EXPECT_FALSE(ours.Compute(pairs, instance->problem.get()));
  EXPECT_FALSE(ours.report().used_stock);
  EXPECT_NE(ours.report().message.find("7 directions are open, which move parameter block 0x"),
            std::string::npos)
      << ours.report().message;
  double block[81];
  EXPECT_FALSE(ours.GetCovarianceBlock(pairs[0].first, pairs[0].first, block));
}

// As a constant: its covariances are zeros, asked for or not.
TEST(CovarianceOfACeresProblem, ABlockNobodyTouchesIsKnown) {
  const std::unique_ptr<Instance> instance = MakeCurveFit(tools::LossSpec());
  const double* x = instance->x.data();
  double lonely[2] = {1.0, 2.0};
  instance->problem->AddParameterBlock(lonely, 2);
  const auto expect_alike = [&](auto& stock, auto& ours) {
    for (const auto& [a, b] : Pairs{{x, x}, {x, lonely}, {lonely, x}, {lonely, lonely}}) {
      std::array<double, 4> expected{}, actual = {7.0, 7.0, 7.0, 7.0};
      ASSERT_TRUE(stock.GetCovarianceBlock(a, b, expected.data()));
      ASSERT_TRUE(ours.GetCovarianceBlock(a, b, actual.data()));
      for (int k = 0; k < (a == x ? 1 : 2) * (b == x ? 1 : 2); ++k) {
        EXPECT_NEAR(actual[k], expected[k], 1e-9 * expected[0]);
      }
    }
  };
  for (const auto algorithm : {ceres::SPARSE_QR, ceres::DENSE_SVD}) {
    for (const Pairs& pairs : {Pairs{{x, x}}, Pairs{{x, x}, {lonely, lonely}, {x, lonely}}}) {
      ceres::Covariance::Options options;
      options.algorithm_type = algorithm;
      ceres::Covariance stock(options);
      ASSERT_TRUE(stock.Compute(pairs, instance->problem.get()));
      Covariance ours(options);
      ASSERT_TRUE(ours.Compute(pairs, instance->problem.get()));
      EXPECT_FALSE(ours.report().used_stock);
      ASSERT_NO_FATAL_FAILURE(expect_alike(stock, ours));
    }
  }
}

// Two parameters of a curve, and a residual block that ties a pair of variables by their sum: one
// direction is open, or nearly.
struct OpenSum {
  explicit OpenSum(double weak) {
    problem.AddResidualBlock(new ceres::AutoDiffCostFunction<Sum, 2, 2, 1>(new Sum{weak}), nullptr,
                             x.data(), &y);
  }
  struct Sum {
    template <typename T>
    bool operator()(const T* x, const T* y, T* r) const {
      r[0] = x[0] + T(2.0) * x[1] + y[0];
      r[1] = T(3.0) * x[1] + T(weak) * y[0];
      return true;
    }
    double weak;
  };
  std::array<double, 2> x = {0.3, -0.2};
  double y = 0.1;
  ceres::Problem problem;
};

// Verdict and values, for each way to leave singular values out.
TEST(CovarianceOfACeresProblem, DenseSvdIsOursAsStocks) {
  for (const bool square : {false, true}) {
    for (const int null_space_rank : {-1, 0, 1, 2}) {
      for (const double rcond : {1e-14, 1e-3, 1e-30}) {
        SCOPED_TRACE(std::to_string(null_space_rank) + (square ? ", square" : "") +
                     std::to_string(rcond));
        OpenSum open(0.5);
        if (square) {  // a third row, which repeats the first
          open.problem.AddResidualBlock(
              new ceres::AutoDiffCostFunction<OpenSum::Sum, 2, 2, 1>(new OpenSum::Sum{0.5}),
              nullptr, open.x.data(), &open.y);
        }
        ceres::Covariance::Options options;
        options.algorithm_type = ceres::DENSE_SVD;
        options.null_space_rank = null_space_rank;
        options.min_reciprocal_condition_number = rcond;
        const Pairs pairs{{open.x.data(), open.x.data()}, {open.x.data(), &open.y}};
        Covariance ours(options);
        ceres::Covariance stock(options);
        const bool computed = stock.Compute(pairs, &open.problem);
        ASSERT_EQ(ours.Compute(pairs, &open.problem), computed) << ours.report().message;
        EXPECT_FALSE(ours.report().used_stock) << ours.report().message;
        if (computed) {
          std::vector<double> expected(4, 7.0), actual(4, 8.0);
          ASSERT_TRUE(stock.GetCovarianceBlock(pairs[0].first, pairs[0].second, expected.data()));
          ASSERT_TRUE(ours.GetCovarianceBlock(pairs[0].first, pairs[0].second, actual.data()));
          ExpectClose(actual, expected);
          ASSERT_TRUE(stock.GetCovarianceBlock(pairs[1].first, pairs[1].second, expected.data()));
          ASSERT_TRUE(ours.GetCovarianceBlock(pairs[1].first, pairs[1].second, actual.data()));
          ExpectClose({actual[0], actual[1]}, {expected[0], expected[1]});
        }
      }
    }
  }
}

// It has no columns, and so no share in the rank.
TEST(CovarianceOfACeresProblem, DenseSvdBesideALonelyBlockIsAsWithout) {
  OpenSum open(0.5);
  double lonely = 1.0;
  open.problem.AddParameterBlock(&lonely, 1);
  ceres::Covariance::Options options;
  options.algorithm_type = ceres::DENSE_SVD;
  options.null_space_rank = -1;
  const Pairs pairs = {{&open.y, &open.y}};
  ceres::Covariance stock(options);
  ASSERT_TRUE(stock.Compute(pairs, &open.problem));
  Covariance ours(options);
  ASSERT_TRUE(ours.Compute(pairs, &open.problem));
  EXPECT_FALSE(ours.report().used_stock);
  double expected = 0.0, actual = 1.0;
  ASSERT_TRUE(stock.GetCovarianceBlock(&open.y, &open.y, &expected));
  ASSERT_TRUE(ours.GetCovarianceBlock(&open.y, &open.y, &actual));
  EXPECT_NEAR(actual, expected, 1e-9 * expected);
}

TEST(CovarianceOfACeresProblem, AnEvaluationCallbackIsCalledOnceAhead) {
  const std::unique_ptr<Instance> instance = MakeCurveFit(tools::LossSpec());
  const double* x = instance->x.data();
  int num_calls = 0;
  lambdas::Preparation callback([&](bool evaluate_jacobians, bool new_evaluation_point) {
    num_calls += evaluate_jacobians && new_evaluation_point ? 1 : 100;
  });
  Covariance ours{ceres::Covariance::Options()};
  ours.SetEvaluationCallback(&callback);
  double variance = 0.0;
  EXPECT_FALSE(ours.GetCovarianceBlock(x, x, &variance)) << "before Compute";
  ASSERT_TRUE(ours.Compute(Pairs{{x, x}}, instance->problem.get()));
  EXPECT_EQ(num_calls, 1);
  EXPECT_TRUE(ours.GetCovarianceBlock(x, x, &variance));
  EXPECT_GT(variance, 0.0);
}

TEST(CovarianceOfACeresProblem, NothingIsKnownAfterAnException) {
  const std::unique_ptr<Instance> instance = MakeCurveFit(tools::LossSpec());
  const double* x = instance->x.data();
  lambdas::Preparation callback([](bool, bool) { throw std::runtime_error("the user's"); });
  Covariance ours{ceres::Covariance::Options()};
  double variance = 0.0;
  ASSERT_TRUE(ours.Compute(Pairs{{x, x}}, instance->problem.get()));
  ours.SetEvaluationCallback(&callback);
  EXPECT_THROW((void)ours.Compute(Pairs{{x, x}}, instance->problem.get()), std::runtime_error);
  EXPECT_FALSE(ours.GetCovarianceBlock(x, x, &variance));
}

TEST(CovarianceOfACeresProblem, HasTheSameBitsForAnyNumberOfThreads) {
  const std::unique_ptr<Instance> instance =
      MakeBal(SmallStreet(5, 1.0), tools::BalCameraModel::kAngleAxis, Gauge::kTwoCamerasConstant,
              Huber(1.0));
  const Pairs pairs = PairsOf(*instance->problem, {{2, 2}, {3, 30}, {40, 40}});
  std::vector<double> values[2] = {std::vector<double>(243), std::vector<double>(243)};
  for (const int num_threads : {1, 4}) {
    ceres::Covariance::Options options;
    options.num_threads = num_threads;
    Covariance ours(options);
    ASSERT_TRUE(ours.Compute(pairs, instance->problem.get()));
    for (std::size_t k = 0; k < pairs.size(); ++k) {
      ours.GetCovarianceBlock(pairs[k].first, pairs[k].second,
                              values[num_threads / 4].data() + 81 * k);
    }
  }
  EXPECT_EQ(values[0], values[1]);
}

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

TEST(RankOfACeresProblem, AScalarThatAllPointsUseUpIsFalse) {
  for (unsigned seed = 0; seed < 50; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    LinearProblem linear;
    double *camera = linear.AddBlock(6), *scalar = linear.AddBlock(1);
    linear.AddResidual({camera}, {RandomRows(&random, 8, 6)});
    for (int l = 0; l < 50; ++l) {
      linear.AddResidual(
          {camera, scalar, linear.AddBlock(3)},
          {RandomRows(&random, 3, 6), RandomRows(&random, 3, 1), RandomRows(&random, 3, 3)});
    }
    ExpectFalseInBoth(seed % 2 == 0 ? scalar : camera, &linear);
  }
}

// The points use up rows of weight 1e7, and one of weight 1 determines: all its digits are those of
// stock.
TEST(RankOfACeresProblem, AWeakPriorBesideStiffPointsIsTrue) {
  for (const double stiff : {1e2, 1e4, 1e7}) {
    for (unsigned seed = 0; seed < 10; ++seed) {
      SCOPED_TRACE(::testing::Message() << stiff << ", seed " << seed);
      Random random(seed);
      LinearProblem linear;
      double* frame = linear.AddBlock(2);
      for (int l = 0; l < 20; ++l) {
        linear.AddResidual({frame, linear.AddBlock(3)},
                           {stiff * RandomRows(&random, 3, 2), stiff * RandomRows(&random, 3, 3)});
      }
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
      SCOPED_TRACE(::testing::Message() << num_fixed << " fixed, rank " << null_space_rank);
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
