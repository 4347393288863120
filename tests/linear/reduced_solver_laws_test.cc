// What every ReducedSolver promises, checked for the built-in ones and for the example of the
// documentation.
#include <algorithm>
#include <functional>
#include <memory>
#include <string>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "linear/dense_cholesky.h"
#include "linear/eigen_ldlt_solver.h"
#include "linear/path_cholesky.h"
#include "linear/random_system.h"
#include "linear/sparse_cholesky.h"
#include "support/dense_oracle.h"

namespace inceres::internal {
namespace {

using Fill = RandomSystem::Fill;

struct SolverCase {
  std::string name;
  std::function<std::unique_ptr<ReducedSolver>(const Executor&)> make;
};

class ReducedSolverLaws : public testing::TestWithParam<SolverCase> {
 protected:
  ReducedSolverLaws() : solver_(GetParam().make(executor_)) {}

  // Factors and solves with several right-hand sides; Eigen's LLT knows the answer.
  void ExpectSolves(RandomSystem& system) {
    const Status factored = solver_->Factorize(system.Matrix(), {});
    ASSERT_TRUE(factored.ok()) << factored.message;
    const int n = system.pattern.size();
    const Eigen::LLT<Eigen::MatrixXd> llt(system.Dense());
    for (int k = 0; k < 2; ++k) {
      const std::vector<double> b = system.random.Vector(static_cast<std::size_t>(n));
      Eigen::VectorXd x = Eigen::VectorXd::Constant(n, 77.0);
      ASSERT_TRUE(solver_->Solve(b.data(), {}, {}, x.data()).ok());
      EXPECT_LT(test::RelativeError(x, llt.solve(Eigen::Map<const Eigen::VectorXd>(b.data(), n))),
                1e-11);
    }
  }

  void ExpectSolvesNew(RandomSystem system) {
    const Status analyzed = solver_->Analyze(system.Matrix());
    ASSERT_TRUE(analyzed.ok()) << analyzed.message;
    ExpectSolves(system);
  }

  Executor executor_{1};
  std::unique_ptr<ReducedSolver> solver_;
};

TEST_P(ReducedSolverLaws, ManySizes) {
  for (const int size : {1, 2, 3, 15, 16, 17, 31, 33, 100, 127, 128, 129, 256, 441}) {
    SCOPED_TRACE(size);
    std::vector<int> sizes(static_cast<std::size_t>(size / 9), 9);
    if (size % 9 > 0) {
      sizes.push_back(size % 9);
    }
    ExpectSolvesNew(RandomSystem(sizes, Fill::kDense));
  }
}

TEST_P(ReducedSolverLaws, PowerOfTwoStrides) {
  for (const int size : {64, 128, 256, 384}) {
    ExpectSolvesNew(
        RandomSystem(std::vector<int>(static_cast<std::size_t>(size / 4), 4), Fill::kBand));
  }
}

TEST_P(ReducedSolverLaws, MixedBlockSizes) {
  ExpectSolvesNew(RandomSystem({6, 1, 15, 9, 3, 7, 33, 2}, Fill::kDense));
  ExpectSolvesNew(RandomSystem({6, 1, 15, 9, 3, 7, 33, 2, 6, 6, 9}, Fill::kBand));
}

TEST_P(ReducedSolverLaws, NoBlocksOffTheDiagonal) {
  ExpectSolvesNew(RandomSystem({3, 6, 1, 9}, Fill::kDiagonal));
  ExpectSolvesNew(RandomSystem(std::vector<int>(200, 3), Fill::kDiagonal));
}

// From 128 blocks on, nested dissection is tried as well.
TEST_P(ReducedSolverLaws, LongBands) {
  ExpectSolvesNew(RandomSystem(std::vector<int>(200, 3), Fill::kBand));
}

TEST_P(ReducedSolverLaws, NewValuesInTheSamePattern) {
  RandomSystem system({6, 9, 6, 3, 15}, Fill::kBand);
  ASSERT_TRUE(solver_->Analyze(system.Matrix()).ok());
  for (int k = 0; k < 3; ++k) {
    ExpectSolves(system);
    system.FillValues();
  }
}

TEST_P(ReducedSolverLaws, ANewPatternReplacesTheOld) {
  ExpectSolvesNew(RandomSystem({6, 6, 6}, Fill::kDense));
  ExpectSolvesNew(RandomSystem({9, 1}, Fill::kDense));
  ExpectSolvesNew(RandomSystem(std::vector<int>(40, 6), Fill::kBand));
}

TEST_P(ReducedSolverLaws, TheUpperTriangleOfDiagonalBlocksIsNotRead) {
  RandomSystem system({3, 5}, Fill::kDense);
  RandomSystem clean = system;
  system.values[1] = 1e9;  // entry (0, 1) of the first block
  ASSERT_TRUE(solver_->Analyze(system.Matrix()).ok());
  ASSERT_TRUE(solver_->Factorize(system.Matrix(), {}).ok());
  const std::vector<double> b(8, 1.0);
  Eigen::VectorXd x(8);
  ASSERT_TRUE(solver_->Solve(b.data(), {}, {}, x.data()).ok());
  EXPECT_LT((clean.Dense() * x - Eigen::VectorXd::Ones(8)).norm(), 1e-12);
}

TEST_P(ReducedSolverLaws, NotPositiveDefiniteIsSingularAndTheSolverWorksAgain) {
  for (const int num_blocks : {2, 30, 150}) {
    for (const int at : {0, 5, num_blocks * 3 - 1}) {
      RandomSystem system(std::vector<int>(static_cast<std::size_t>(num_blocks), 3), Fill::kBand);
      ASSERT_TRUE(solver_->Analyze(system.Matrix()).ok());
      const std::vector<double> good = system.diagonal;
      for (int round = 0; round < 2; ++round) {
        system.Spoil(at);
        const Status failed = solver_->Factorize(system.Matrix(), {});
        EXPECT_EQ(failed.code, StatusCode::kSingular) << num_blocks << " blocks, row " << at;
        EXPECT_NE(failed.message.find("not positive definite"), std::string::npos)
            << failed.message;
        system.diagonal = good;
        ExpectSolves(system);
      }
    }
  }
}

TEST_P(ReducedSolverLaws, ZeroMatrixAndNaNAreSingular) {
  RandomSystem system({3, 3}, Fill::kDense);
  ASSERT_TRUE(solver_->Analyze(system.Matrix()).ok());
  const std::vector<double> zeros(system.values.size(), 0.0);
  const std::vector<double> no_diagonal(6, 0.0);
  EXPECT_EQ(
      solver_->Factorize(ReducedMatrix(system.pattern, zeros.data(), no_diagonal.data()), {}).code,
      StatusCode::kSingular);
  std::vector<double> nan = system.values;
  nan[0] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(
      solver_->Factorize(ReducedMatrix(system.pattern, nan.data(), system.diagonal.data()), {})
          .code,
      StatusCode::kSingular);
  ExpectSolves(system);
}

TEST_P(ReducedSolverLaws, HasAName) {
  ExpectSolvesNew(RandomSystem({3}, Fill::kDense));
  EXPECT_FALSE(std::string(solver_->Name()).empty());
}

INSTANTIATE_TEST_SUITE_P(
    Solvers, ReducedSolverLaws,
    testing::Values(SolverCase{"DenseCholesky",
                               [](const Executor& executor) {
                                 return std::make_unique<DenseCholesky>(executor);
                               }},
                    SolverCase{"SparseCholesky",
                               [](const Executor& executor) {
                                 return std::make_unique<SparseCholesky>(executor);
                               }},
                    SolverCase{"PathCholesky",
                               [](const Executor& executor) {
                                 return std::make_unique<PathCholesky>(executor);
                               }},
                    SolverCase{
                        "EigenLdlt",
                        [](const Executor&) { return std::make_unique<EigenLdltSolver>(); }}),
    [](const auto& instance) { return instance.param.name; });

}  // namespace
}  // namespace inceres::internal
