#include "linear/sparse_cholesky.h"

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "linear/random_system.h"
#include "support/dense_oracle.h"

namespace inceres::internal {
namespace {

// A path of frames of 6 that know the ten before them, with a loop every 60 frames: subtrees beside
// each other, large fronts above.
RandomSystem PathWithLoops(int num_frames, unsigned seed = 1) {
  return {std::vector<int>(static_cast<std::size_t>(num_frames), 6),
          [](int i, int j) {
            return i - j <= 10 || (i % 60 == 0 && j % 60 == 0 && (i - j) % 180 == 0);
          },
          seed};
}

std::vector<double> Ramp(int size) {
  std::vector<double> b(static_cast<std::size_t>(size));
  for (std::size_t k = 0; k < b.size(); ++k) {
    b[k] = static_cast<double>(k % 13) - 6.0;
  }
  return b;
}

// Cameras of 6, each coupled to half of a few points of 3, and sets of such that share nothing but
// one last block: fronts with very many children, some of them in subtrees beside each other.
RandomSystem FewPointsSeenByMany(int num_cameras, int num_points, int num_sets, unsigned seed) {
  std::vector<int> sizes;
  std::vector<int> set_of;
  test::Random random(seed);
  std::set<std::pair<int, int>> coupled;
  for (int s = 0; s < num_sets; ++s) {
    const int first_point = static_cast<int>(sizes.size());
    sizes.insert(sizes.end(), static_cast<std::size_t>(num_points), 3);
    for (int c = 0; c < num_cameras; ++c) {
      for (int p = 0; p < num_points; ++p) {
        if (random.Between(0.0, 1.0) < 0.5) {
          coupled.emplace(static_cast<int>(sizes.size()), first_point + p);
        }
      }
      sizes.push_back(6);
    }
  }
  for (int block = 0; block < static_cast<int>(sizes.size()); ++block) {
    coupled.emplace(static_cast<int>(sizes.size()), block);
  }
  sizes.push_back(5);
  return {sizes, coupled, seed};
}

struct Factored {
  Factored(int num_threads, const RandomSystem& system) : executor(num_threads), solver(executor) {
    EXPECT_TRUE(solver.Analyze(system.Matrix()).ok());
    status = solver.Factorize(system.Matrix(), {});
  }
  std::vector<double> Solve(const std::vector<double>& b) {
    std::vector<double> x(b.size());
    EXPECT_TRUE(solver.Solve(b.data(), {}, {}, x.data()).ok());
    return x;
  }
  Executor executor;
  SparseCholesky solver;
  Status status;
};

TEST(SparseCholesky, SolvesALongPathWithLoops) {
  const RandomSystem system = PathWithLoops(400);
  Factored factored(2, system);
  ASSERT_TRUE(factored.status.ok()) << factored.status.message;
  const std::vector<double> b = Ramp(system.pattern.size());
  const std::vector<double> x = factored.Solve(b);
  const auto n = static_cast<Eigen::Index>(b.size());
  const Eigen::VectorXd expected =
      system.Dense().llt().solve(Eigen::Map<const Eigen::VectorXd>(b.data(), n));
  EXPECT_LT(test::RelativeError(Eigen::Map<const Eigen::VectorXd>(x.data(), n), expected), 1e-12);
}

TEST(SparseCholesky, SameBitsForAnyNumberOfThreads) {
  for (const int num_frames : {50, 300, 900}) {
    const RandomSystem system = PathWithLoops(num_frames);
    const std::vector<double> b = Ramp(system.pattern.size());
    const std::vector<double> one = Factored(1, system).Solve(b);
    EXPECT_EQ(Factored(1, system).Solve(b), one);
    EXPECT_EQ(Factored(2, system).Solve(b), one) << num_frames << " frames";
    EXPECT_EQ(Factored(4, system).Solve(b), one) << num_frames << " frames";
  }
}

// A street grid of blocks, each coupled to those up to two away: dear enough for its size to be cut
// into many parts.
RandomSystem Grid(int width, int height, int block_size) {
  const auto is_near = [width](int i, int j) {
    return std::abs(i / width - j / width) <= 2 && std::abs(i % width - j % width) <= 2;
  };
  return {std::vector<int>(static_cast<std::size_t>(width * height), block_size), is_near, 1};
}

TEST(SparseCholesky, SolvesGridInParts) {
  const RandomSystem system = Grid(24, 24, 7);
  Factored factored(1, system);
  ASSERT_TRUE(factored.status.ok()) << factored.status.message;
  EXPECT_STREQ(factored.solver.Name(), "sparse Cholesky, dissected");
  const std::vector<double> b = Ramp(system.pattern.size());
  const std::vector<double> x = factored.Solve(b);
  const auto n = static_cast<Eigen::Index>(b.size());
  const Eigen::VectorXd product = system.Dense() * Eigen::Map<const Eigen::VectorXd>(x.data(), n);
  EXPECT_LT(test::RelativeError(product, Eigen::Map<const Eigen::VectorXd>(b.data(), n)), 1e-12);
  EXPECT_EQ(Factored(2, system).Solve(b), x);
  EXPECT_EQ(Factored(4, system).Solve(b), x);
}

TEST(SparseCholesky, SolvesForFewPointsSeenByMany) {
  for (const unsigned seed : {1U, 2U, 3U}) {
    const RandomSystem system = FewPointsSeenByMany(60, 14, static_cast<int>(seed), seed);
    const std::vector<double> b = Ramp(system.pattern.size());
    const std::vector<double> x = Factored(1, system).Solve(b);
    EXPECT_EQ(Factored(2, system).Solve(b), x) << "seed " << seed;
    const auto n = static_cast<Eigen::Index>(b.size());
    const Eigen::VectorXd expected =
        system.Dense().llt().solve(Eigen::Map<const Eigen::VectorXd>(b.data(), n));
    EXPECT_LT(test::RelativeError(Eigen::Map<const Eigen::VectorXd>(x.data(), n), expected), 1e-12)
        << "seed " << seed;
  }
}

// Heavy sets are tasks beside each other.
TEST(SparseCholesky, SameBitsForFewPointsSeenByManyInTasks) {
  const RandomSystem system = FewPointsSeenByMany(150, 40, 3, 4);
  const std::vector<double> b = Ramp(system.pattern.size());
  const std::vector<double> one = Factored(1, system).Solve(b);
  for (int repetition = 0; repetition < 3; ++repetition) {
    EXPECT_EQ(Factored(2, system).Solve(b), one);
    EXPECT_EQ(Factored(4, system).Solve(b), one);
  }
}

// The update matrices of a thousand cameras, 40 times the factor's columns of a camera each, do not
// wait for the front of the points.
TEST(SparseCholesky, MemoryForFewPointsSeenByManyIsThatOfTheFactor) {
  const RandomSystem system = FewPointsSeenByMany(800, 40, 1, 5);
  const Factored factored(1, system);
  EXPECT_LT(static_cast<double>(factored.solver.Bytes()),
            2.0 * sizeof(double) * factored.solver.PredictedEntries());
}

TEST(SparseCholesky, NamesTheFrameThatFails) {
  for (const int frame : {0, 17, 180, 299}) {
    RandomSystem system = PathWithLoops(300);
    system.Spoil(6 * frame + 4);
    const Factored factored(2, system);
    EXPECT_EQ(factored.status.code, StatusCode::kSingular);
    EXPECT_EQ(factored.status.message,
              "the reduced system is not positive definite at frame " + std::to_string(frame));
  }
}

TEST(SparseCholesky, WorksAgainAfterAFailure) {
  RandomSystem system = PathWithLoops(300);
  Factored factored(2, system);
  const std::vector<double> b = Ramp(system.pattern.size());
  const std::vector<double> x = factored.Solve(b);
  const std::vector<double> good = system.diagonal;
  system.Spoil(700);
  EXPECT_FALSE(factored.solver.Factorize(system.Matrix(), {}).ok());
  EXPECT_TRUE(factored.solver
                  .Factorize(ReducedMatrix(system.pattern, system.values.data(), good.data()), {})
                  .ok());
  EXPECT_EQ(factored.Solve(b), x);
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
