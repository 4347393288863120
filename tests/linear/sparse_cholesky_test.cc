#include "linear/sparse_cholesky.h"

#include <cstring>
#include <string>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "linear/random_system.h"
#include "support/dense_oracle.h"

namespace inceres::internal {
namespace {

// A path of frames of 6 that know the ten before them, with a loop every 60 frames: subtrees beside each other, large fronts
// above.
RandomSystem PathWithLoops(int num_frames, unsigned seed = 1) {
  return {std::vector<int>(static_cast<std::size_t>(num_frames), 6),
          [](int i, int j) { return i - j <= 10 || (i % 60 == 0 && j % 60 == 0 && (i - j) % 180 == 0); }, seed};
}

std::vector<double> Ramp(int size) {
  std::vector<double> b(static_cast<std::size_t>(size));
  for (std::size_t k = 0; k < b.size(); ++k) {
    b[k] = static_cast<double>(k % 13) - 6.0;
  }
  return b;
}

struct Factored {
  Factored(int num_threads, const RandomSystem& system) : executor(num_threads), solver(executor) {
    EXPECT_TRUE(solver.Analyze(system.pattern).ok());
    status = solver.Factorize(system.values.data(), system.diagonal.data());
  }
  std::vector<double> Solve(const std::vector<double>& b) {
    std::vector<double> x(b.size());
    EXPECT_TRUE(solver.Solve(b.data(), x.data()).ok());
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
  const Eigen::VectorXd expected = system.Dense().llt().solve(Eigen::Map<const Eigen::VectorXd>(b.data(), n));
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

TEST(SparseCholesky, NamesTheFrameThatFails) {
  for (const int frame : {0, 17, 180, 299}) {
    RandomSystem system = PathWithLoops(300);
    system.Spoil(6 * frame + 4);
    const Factored factored(2, system);
    EXPECT_EQ(factored.status.code, StatusCode::kSingular);
    EXPECT_EQ(factored.status.message, "the reduced system is not positive definite at frame " + std::to_string(frame));
  }
}

TEST(SparseCholesky, WorksAgainAfterAFailure) {
  RandomSystem system = PathWithLoops(300);
  Factored factored(2, system);
  const std::vector<double> b = Ramp(system.pattern.size());
  const std::vector<double> x = factored.Solve(b);
  const std::vector<double> good = system.diagonal;
  system.Spoil(700);
  EXPECT_FALSE(factored.solver.Factorize(system.values.data(), system.diagonal.data()).ok());
  EXPECT_TRUE(factored.solver.Factorize(system.values.data(), good.data()).ok());
  EXPECT_EQ(factored.Solve(b), x);
}

// The factor of a path takes memory in proportion to its length, and less than a few times that of S.
TEST(SparseCholesky, MemoryGrowsWithTheFactor) {
  const RandomSystem half = PathWithLoops(400);
  const RandomSystem whole = PathWithLoops(800);
  const std::size_t of_half = Factored(1, half).solver.Bytes();
  const std::size_t of_whole = Factored(1, whole).solver.Bytes();
  EXPECT_LT(of_whole, of_half * 5 / 2);
  EXPECT_LT(of_whole, 5 * sizeof(double) * whole.values.size());
}

}  // namespace
}  // namespace inceres::internal
