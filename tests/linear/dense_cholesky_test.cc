#include "linear/dense_cholesky.h"

#include <string>

#include <gtest/gtest.h>

#include "linear/random_system.h"

namespace inceres::internal {
namespace {

using Fill = RandomSystem::Fill;

std::vector<double> SolveWith(int num_threads, const RandomSystem& system) {
  const Executor executor(num_threads);
  DenseCholesky solver(executor);
  EXPECT_TRUE(solver.Analyze(system.Matrix()).ok());
  EXPECT_TRUE(solver.Factorize(system.Matrix(), {}).ok());
  const auto n = static_cast<std::size_t>(system.pattern.size());
  std::vector<double> b(n);
  for (std::size_t k = 0; k < n; ++k) {
    b[k] = static_cast<double>(k % 13) - 6.0;
  }
  std::vector<double> x(n);
  EXPECT_TRUE(solver.Solve(b.data(), {}, {}, x.data()).ok());
  return x;
}

// Sizes around the panel, the strip of rows, and the size below which no thread is woken.
TEST(DenseCholesky, SameBitsForAnyNumberOfThreads) {
  for (const int num_blocks : {1, 14, 15, 33, 49, 70}) {
    const RandomSystem system(std::vector<int>(static_cast<std::size_t>(num_blocks), 9),
                              Fill::kDense);
    const std::vector<double> one = SolveWith(1, system);
    EXPECT_EQ(SolveWith(1, system), one);
    EXPECT_EQ(SolveWith(2, system), one) << num_blocks << " blocks";
    EXPECT_EQ(SolveWith(4, system), one) << num_blocks << " blocks";
  }
}

TEST(DenseCholesky, NamesTheFrameThatFails) {
  RandomSystem system({6, 9, 3, 15}, Fill::kDense);
  const Executor executor(1);
  DenseCholesky solver(executor);
  ASSERT_TRUE(solver.Analyze(system.Matrix()).ok());
  system.Spoil(16);  // the second row of frame 2
  const Status status = solver.Factorize(system.Matrix(), {});
  EXPECT_EQ(status.code, StatusCode::kSingular);
  EXPECT_NE(status.message.find("at frame 2"), std::string::npos) << status.message;
}

}  // namespace
}  // namespace inceres::internal
