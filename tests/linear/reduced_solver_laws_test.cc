// What every ReducedSolver promises, checked for the built-in ones and for the example of the
// documentation.
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "linear/dense_cholesky.h"
#include "linear/eigen_ldlt_solver.h"
#include "linear/path_cholesky.h"
#include "linear/random_scenes.h"
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

template <typename Solver>
std::unique_ptr<ReducedSolver> Make(const Executor& executor) {
  return std::make_unique<Solver>(executor);
}

INSTANTIATE_TEST_SUITE_P(Solvers, ReducedSolverLaws,
                         testing::Values(SolverCase{"DenseCholesky", Make<DenseCholesky>},
                                         SolverCase{"SparseCholesky", Make<SparseCholesky>},
                                         SolverCase{"PathCholesky", Make<PathCholesky>},
                                         SolverCase{"EigenLdlt",
                                                    [](const Executor&) {
                                                      return std::make_unique<EigenLdltSolver>();
                                                    }}),
                         [](const auto& instance) { return instance.param.name; });

// Large enough for several threads.
struct SceneCase {
  std::string name;
  std::function<std::unique_ptr<ReducedSolver>(const Executor&)> make;
  const char* solver;
  std::function<RandomSystem()> scene;
  int rows_of_node = 1;  // by the first of which a solver may name what fails
};

class ReducedSolverScenes : public testing::TestWithParam<SceneCase> {
 protected:
  ReducedSolverScenes()
      : system_(GetParam().scene()),
        b_(system_.random.Vector(static_cast<std::size_t>(system_.pattern.size()))) {}

  std::unique_ptr<ReducedSolver> Analyzed(const Executor& executor) const {
    std::unique_ptr<ReducedSolver> solver = GetParam().make(executor);
    EXPECT_TRUE(solver->Analyze(system_.Matrix()).ok());
    EXPECT_STREQ(solver->Name(), GetParam().solver);
    return solver;
  }
  std::vector<double> SolveBy(ReducedSolver* solver) const {
    const Status factored = solver->Factorize(system_.Matrix(), {});
    EXPECT_TRUE(factored.ok()) << factored.message;
    std::vector<double> x(b_.size());
    EXPECT_TRUE(solver->Solve(b_.data(), {}, {}, x.data()).ok());
    return x;
  }
  std::vector<double> SolveOn(int num_threads) const {
    const Executor executor(num_threads);
    return SolveBy(Analyzed(executor).get());
  }

  RandomSystem system_;
  std::vector<double> b_;
};

TEST_P(ReducedSolverScenes, AreSolvedWithTheSameBitsOnAnyNumberOfThreads) {
  const std::vector<double> x = SolveOn(1);
  const auto n = static_cast<Eigen::Index>(b_.size());
  EXPECT_LT(test::RelativeError(system_.Times(Eigen::Map<const Eigen::VectorXd>(x.data(), n)),
                                Eigen::Map<const Eigen::VectorXd>(b_.data(), n)),
            1e-12);
  EXPECT_EQ(SolveOn(1), x);
  for (int repetition = 0; repetition < 3; ++repetition) {
    EXPECT_EQ(SolveOn(2), x);
    EXPECT_EQ(SolveOn(4), x);
  }
}

TEST_P(ReducedSolverScenes, TheFrameThatFailsIsNamedAndTheSolverWorksAgain) {
  const std::vector<double> x = SolveOn(1);
  const std::vector<double> good = system_.diagonal;
  const int n = system_.pattern.num_blocks();
  for (const int num_threads : {1, 2}) {
    const Executor executor(num_threads);
    const std::unique_ptr<ReducedSolver> solver = Analyzed(executor);
    for (const int frame : {0, n / 17, n / 3, (n - 1) / 2, n / 2, 3 * n / 5, n - 1}) {
      system_.Spoil(system_.pattern.offsets[static_cast<std::size_t>(frame)] +
                    2 * system_.pattern.block_size(frame) / 3);
      const Status failed = solver->Factorize(system_.Matrix(), {});
      EXPECT_EQ(failed.code, StatusCode::kSingular);
      const std::string message = "the reduced system is not positive definite at frame ";
      const int first_of_node = frame - frame % GetParam().rows_of_node;
      EXPECT_TRUE(failed.message == message + std::to_string(frame) ||
                  failed.message == message + std::to_string(first_of_node))
          << frame << ": " << failed.message;
      std::vector<double> none(x.size());
      EXPECT_EQ(solver->Solve(b_.data(), {}, {}, none.data()).code, StatusCode::kSingular);
      system_.diagonal = good;
      EXPECT_EQ(SolveBy(solver.get()), x);
    }
  }
}

// Of a dense solver around the panel, the strip of rows, and the size below which no thread is
// woken.
SceneCase DenseScene(const std::string& name, const std::vector<int>& sizes) {
  return {"Dense" + name, Make<DenseCholesky>, "dense Cholesky",
          [sizes] { return RandomSystem(sizes, Fill::kDense); }};
}
SceneCase SparseScene(const std::string& name, const char* order,
                      const std::function<RandomSystem()>& scene) {
  return {"Sparse" + name, Make<SparseCholesky>, order, scene};
}

constexpr const char* kAmd = "sparse Cholesky, AMD";
constexpr const char* kDissected = "sparse Cholesky, dissected";

INSTANTIATE_TEST_SUITE_P(
    Scenes, ReducedSolverScenes,
    testing::Values(
        DenseScene("Mixed", {6, 9, 3, 15}), DenseScene("1", {9}),
        DenseScene("14", std::vector<int>(14, 9)), DenseScene("15", std::vector<int>(15, 9)),
        DenseScene("33", std::vector<int>(33, 9)), DenseScene("49", std::vector<int>(49, 9)),
        DenseScene("70", std::vector<int>(70, 9)),
        SparseScene("Path50", kAmd, [] { return PathWithLoops(50); }),
        SparseScene("Path300", kAmd, [] { return PathWithLoops(300); }),
        SparseScene("Path900", kAmd, [] { return PathWithLoops(900); }),
        SparseScene("Grid", kDissected, [] { return Grid(24, 24, 7); }),
        SparseScene("FewPoints1", kAmd, [] { return FewPointsSeenByMany(60, 14, 1, 1); }),
        SparseScene("FewPoints2", kAmd, [] { return FewPointsSeenByMany(60, 14, 2, 2); }),
        SparseScene("FewPoints3", kAmd, [] { return FewPointsSeenByMany(60, 14, 3, 3); }),
        // Heavy sets are tasks beside each other.
        SparseScene("FewPointsInTasks", kDissected,
                    [] { return FewPointsSeenByMany(150, 40, 3, 4); }),
        SceneCase{"Path", Make<PathCholesky>, "sparse Cholesky, paths first",
                  [] {
                    RandomSystem system = Odometry(900, {3, 3}, 5);
                    EXPECT_GT(FindBlockPaths(system.pattern).paths.size(), 60u) << "for tasks";
                    return system;
                  },
                  2}),
    [](const auto& instance) { return instance.param.name; });

}  // namespace
}  // namespace inceres::internal
