#include "linear/sparse_cholesky.h"

#include <algorithm>
#include <vector>

#include <gtest/gtest.h>

#include "linear/random_scenes.h"

namespace inceres::internal {
namespace {

std::vector<double> Ramp(int size) {
  std::vector<double> b(static_cast<std::size_t>(size));
  for (std::size_t k = 0; k < b.size(); ++k) {
    b[k] = static_cast<double>(k % 13) - 6.0;
  }
  return b;
}

struct Factored {
  Factored(int num_threads, const RandomSystem& system) : executor(num_threads), solver(executor) {
    EXPECT_TRUE(solver.Analyze(system.Matrix()).ok());
    EXPECT_TRUE(solver.Factorize(system.Matrix(), {}).ok());
  }
  std::vector<double> Solve(const std::vector<double>& b) {
    std::vector<double> x(b.size());
    EXPECT_TRUE(solver.Solve(b.data(), {}, {}, x.data()).ok());
    return x;
  }
  Executor executor;
  SparseCholesky solver;
};

// The update matrices of a thousand cameras, 40 times the factor's columns of a camera each, do not
// wait for the front of the points.
TEST(SparseCholesky, MemoryForFewPointsSeenByManyIsThatOfTheFactor) {
  const RandomSystem system = FewPointsSeenByMany(800, 40, 1, 5);
  const Factored factored(1, system);
  EXPECT_LT(static_cast<double>(factored.solver.Bytes()),
            2.0 * sizeof(double) * factored.solver.PredictedEntries());
}

// The factor of a path takes memory in proportion to its length, and less than a few times that of
// S.
TEST(SparseCholesky, MemoryGrowsWithTheFactor) {
  const RandomSystem half = PathWithLoops(400);
  const RandomSystem whole = PathWithLoops(800);
  const std::size_t of_half = Factored(1, half).solver.Bytes();
  const std::size_t of_whole = Factored(1, whole).solver.Bytes();
  EXPECT_LT(of_whole, of_half * 5 / 2);
  EXPECT_LT(of_whole, 5 * sizeof(double) * whole.values.size());
}

// S waits where columns of later fronts will be: parents that are opened early, tasks beside each
// other, and a second factorization in the same memory.
TEST(SparseCholesky, HasTheSameBitsWhereSIsInTheMemoryOfItsFactor) {
  for (const RandomSystem& system :
       {PathWithLoops(300), FewPointsSeenByMany(150, 40, 3, 4), Grid(24, 24, 7),
        RandomSystem({3}, RandomSystem::Fill::kDense)}) {
    const std::vector<double> b = Ramp(system.pattern.size());
    const std::vector<double> expected = Factored(1, system).Solve(b);
    for (const int num_threads : {1, 2, 4}) {
      const Executor executor(num_threads);
      SparseCholesky solver(executor);
      BlockPattern pattern = system.pattern;
      ASSERT_TRUE(solver.Analyze(ReducedMatrix(pattern, nullptr, nullptr)).ok());
      double* const S = solver.PlaceValues(&pattern);
      for (int factorization = 0; factorization < 2; ++factorization) {
        for (std::size_t k = 0; k < pattern.columns.size(); ++k) {
          std::copy(system.values.begin() + system.pattern.value_begin[k],
                    system.values.begin() + system.pattern.value_begin[k + 1],
                    S + pattern.value_begin[k]);
        }
        const ReducedMatrix A(pattern, S, system.diagonal.data());
        ASSERT_TRUE(solver.Factorize(A, {}).ok());
        std::vector<double> x(b.size());
        ASSERT_TRUE(solver.Solve(b.data(), {}, {}, x.data()).ok());
        EXPECT_EQ(x, expected) << num_threads << " threads, factorization " << factorization;
      }
    }
  }
}

TEST(SparseCholesky, SInTheMemoryOfItsFactorTakesLittleMore) {
  const RandomSystem system = PathWithLoops(300);
  const std::size_t bytes_without_S = Factored(1, system).solver.Bytes();
  const Executor executor(1);
  SparseCholesky solver(executor);
  BlockPattern pattern = system.pattern;
  ASSERT_TRUE(solver.Analyze(ReducedMatrix(pattern, nullptr, nullptr)).ok());
  solver.PlaceValues(&pattern);
  EXPECT_LT(solver.Bytes(), bytes_without_S + sizeof(double) * system.values.size() / 4);
}

// On one thread the update matrices of all tasks are in one stack.
TEST(SparseCholesky, TakesLessMemoryOnOneThread) {
  const RandomSystem system = Grid(24, 24, 7);
  const Factored one(1, system), two(2, system);
  EXPECT_LT(one.solver.Bytes(), two.solver.Bytes());
}

}  // namespace
}  // namespace inceres::internal
