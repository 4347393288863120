// Paths eliminated before the rest, against a dense factor.
#include "linear/path_cholesky.h"

#include <algorithm>
#include <cstdlib>
#include <string>
#include <vector>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "linear/growing_system.h"
#include "linear/random_system.h"
#include "linear/select_solver.h"
#include "support/dense_oracle.h"

namespace inceres::internal {
namespace {

// Poses of so many rows, each row coupled to all of the poses beside it; loops between some, a
// branch that ends freely, and a ring that hangs on one pose.
RandomSystem Odometry(int num_poses, const std::vector<int>& rows_of_pose, unsigned seed) {
  const int num_rows = static_cast<int>(rows_of_pose.size());
  std::vector<int> sizes;
  for (int pose = 0; pose < num_poses; ++pose) {
    sizes.insert(sizes.end(), rows_of_pose.begin(), rows_of_pose.end());
  }
  test::Random random(seed);
  std::vector<std::pair<int, int>> loops;
  for (int k = 0; k < num_poses / 12; ++k) {
    loops.emplace_back(random.Below(num_poses / 2), random.Below(num_poses / 2));
  }
  // The branch begins in the middle, the ring before the last fifth.
  const int branch = num_poses / 2, ring = num_poses - num_poses / 5;
  return {sizes,
          [=](int i, int j) {
            const int a = i / num_rows, b = j / num_rows;
            const bool in_turn = a - b <= 1 && a != branch;
            const bool at_branch = a == branch && (b == branch || b == 2);
            const bool closes_ring = a == num_poses - 1 && b == ring;
            return in_turn || at_branch || closes_ring ||
                   std::any_of(loops.begin(), loops.end(), [&](const auto& loop) {
                     return std::max(loop.first, loop.second) == a &&
                            std::min(loop.first, loop.second) == b;
                   });
          },
          seed};
}

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

// Several tasks of paths.
TEST(PathCholesky, SameBitsForAnyNumberOfThreads) {
  RandomSystem system = Odometry(900, {3, 3}, 5);
  EXPECT_GT(FindBlockPaths(system.pattern).paths.size(), 60u);
  const auto b = system.random.Vector(static_cast<std::size_t>(system.pattern.size()));
  const Executor one(1);
  PathCholesky solver(one);
  const Eigen::VectorXd x = SolveBy(&solver, system, b);
  for (const int num_threads : {2, 4}) {
    const Executor several(num_threads);
    PathCholesky on_several(several);
    EXPECT_EQ(x, SolveBy(&on_several, system, b)) << num_threads << " threads";
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

TEST(PathCholesky, NamesTheRowThatIsNotDefinite) {
  for (const int row : {0, 7, 20, 59, 77, 119}) {
    RandomSystem system = Odometry(60, {3, 3}, 2);
    const Executor executor(1);
    PathCholesky solver(executor);
    ASSERT_TRUE(solver.Analyze(system.Matrix()).ok());
    ASSERT_TRUE(solver.Factorize(system.Matrix(), {}).ok());
    system.Spoil(3 * row + 1);
    const Status failed = solver.Factorize(system.Matrix(), {});
    EXPECT_EQ(failed.code, StatusCode::kSingular);
    // Of a node of the rest its first row is told.
    const bool is_named =
        failed.message.find("frame " + std::to_string(row)) != std::string::npos ||
        failed.message.find("frame " + std::to_string(row - row % 2)) != std::string::npos;
    EXPECT_TRUE(is_named) << row << ": " << failed.message;
    std::vector<double> x(static_cast<std::size_t>(system.pattern.size()));
    EXPECT_EQ(solver.Solve(system.diagonal.data(), {}, {}, x.data()).code, StatusCode::kSingular);
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
