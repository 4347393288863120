// Paths eliminated before the rest, against a dense factor.
#include "linear/path_cholesky.h"

#include <algorithm>
#include <string>
#include <vector>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "linear/growing_system.h"
#include "linear/random_scenes.h"
#include "linear/select_solver.h"
#include "support/dense_oracle.h"

namespace inceres::internal {
namespace {

Eigen::VectorXd SolveBy(ReducedSolver* solver, const RandomSystem& system,
                        const std::vector<double>& b) {
  Eigen::VectorXd x(static_cast<Eigen::Index>(b.size()));
  EXPECT_TRUE(solver->Analyze(system.Matrix()).ok());
  const Status factored = solver->Factorize(system.Matrix(), {});
  EXPECT_TRUE(factored.ok()) << factored.message;
  EXPECT_TRUE(solver->Solve(b.data(), {}, {}, x.data()).ok());
  return x;
}

TEST(PathCholesky, SolvesAsADenseFactorDoes) {
  const std::vector<int> poses[] = {{3}, {6}, {3, 3}, {1, 1, 1}, {1}, {2}, {4}, {5}, {7}, {8}};
  for (const std::vector<int>& pose : poses) {
    for (unsigned seed = 1; seed <= 3; ++seed) {
      RandomSystem system = Odometry(60, pose, seed);
      EXPECT_GT(FindBlockPaths(system.pattern).nodes.size(), 30u);
      const auto b = system.random.Vector(static_cast<std::size_t>(system.pattern.size()));
      const Eigen::VectorXd expected = system.Dense().llt().solve(
          Eigen::Map<const Eigen::VectorXd>(b.data(), static_cast<Eigen::Index>(b.size())));
      const Executor one(1);
      PathCholesky solver(one);
      const Eigen::VectorXd x = SolveBy(&solver, system, b);
      EXPECT_LT(test::RelativeError(x, expected), 1e-12) << pose.size() << " rows, seed " << seed;
      std::vector<int> order = solver.order();
      std::sort(order.begin(), order.end());
      ASSERT_EQ(order.size(), static_cast<std::size_t>(system.pattern.num_blocks()));
      EXPECT_TRUE(std::adjacent_find(order.begin(), order.end()) == order.end());
    }
  }
}

// Where it is the whole of S, and where there is none.
TEST(PathCholesky, SolvesOnePathAndNone) {
  for (const bool has_path : {true, false}) {
    RandomSystem system(
        std::vector<int>(9, 3), [has_path](int i, int j) { return !has_path || i - j == 1; }, 1);
    const auto b = system.random.Vector(27);
    const Executor executor(1);
    PathCholesky solver(executor);
    EXPECT_LT(test::RelativeError(
                  SolveBy(&solver, system, b),
                  system.Dense().llt().solve(Eigen::Map<const Eigen::VectorXd>(b.data(), 27))),
              1e-12);
  }
}

// Rows of a living matrix, whose blocks are padded, and some of which are held.
TEST(PathCholesky, LeavesOutWhatIsHeld) {
  GrowingSystem system(4);
  for (int row = 0; row < 40; ++row) {
    system.AddRow(3, 1, row % 13 == 12);
  }
  for (const int row : {0, 11, 12, 39}) {
    system.held[static_cast<std::size_t>(row)] = 1;
  }
  const Executor executor(1);
  PathCholesky solver(executor);
  ASSERT_TRUE(solver.Analyze(system.Matrix()).ok());
  ASSERT_TRUE(solver.Factorize(system.Matrix(), {}).ok());
  const Eigen::VectorXd b = system.FreeB();
  Eigen::VectorXd x(b.size());
  ASSERT_TRUE(solver.Solve(b.data(), {}, {}, x.data()).ok());
  EXPECT_LT(test::RelativeError(x, system.Dense().llt().solve(b)), 1e-12);
}

TEST(PathCholesky, IsChosenForLongPathsOnly) {
  const auto name_of = [](const BlockPattern& pattern) {
    const Executor executor(1);
    Status status;
    const auto solver =
        MakeReducedSolver(ReducedSolverKind::kSparse, {}, pattern, executor, &status);
    EXPECT_TRUE(status.ok());
    return std::string(solver->Name());
  };
  const std::string paths = PathCholesky(Executor(1)).Name();
  RandomSystem odometry = Odometry(60, {3}, 1);
  EXPECT_EQ(name_of(odometry.pattern), paths);
  // Who says in which order is not overruled.
  odometry.pattern.groups.assign(60, 0);
  odometry.pattern.groups[5] = 1;
  EXPECT_NE(name_of(odometry.pattern), paths);
  // A grid has none, a ladder none that are long.
  EXPECT_NE(name_of(RandomSystem(std::vector<int>(100, 3), RandomSystem::Fill::kBand).pattern),
            paths);
}

}  // namespace
}  // namespace inceres::internal
