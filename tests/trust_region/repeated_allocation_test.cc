// A second solve of a structure asks for no memory at all, of whatever library.
#include <algorithm>
#include <cstdint>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/solver/solver.h"
#include "support/allocations.h"
#include "trust_region/solver_way.h"

namespace inceres {
namespace {

class RepeatedAllocations : public testing::TestWithParam<test::SolverWay> {
 protected:
  // Allocations of a solve of `graph`.
  std::int64_t Count(const SolverOptions& options, FactorGraph* graph) {
    const std::int64_t before = test::NumAllocations();
    solver_.Solve(options, graph, &summary_);
    const std::int64_t count = test::NumAllocations() - before;
    EXPECT_TRUE(summary_.IsSolutionUsable()) << summary_.message;
    return count;
  }
  Solver solver_{std::int64_t{1} << 30};
  Summary summary_;
};

TEST_P(RepeatedAllocations, NoneInASecondSolve) {
  if (!test::CanCountAllocations()) {
    GTEST_SKIP() << "this build has an allocator of its own";
  }
  for (const int num_threads : {1, 2}) {
    const auto first = GetParam().make(/*other_numbers=*/false);
    const auto second = GetParam().make(/*other_numbers=*/true);
    SolverOptions options = GetParam().options;
    options.num_threads = num_threads;
    options.max_num_iterations = 20;
    EXPECT_GT(Count(options, first.get()), 100);  // or the counter counts nothing
    EXPECT_FALSE(summary_.structure_reused);
    options.max_num_iterations = 15;
    {
      const test::AllocationTrap trap;
      EXPECT_EQ(Count(options, second.get()), 0);
    }
    EXPECT_TRUE(summary_.structure_reused);
    EXPECT_GT(summary_.iterations.size(), 10u);
    EXPECT_GT(summary_.num_successful_steps, 3);
  }
}

std::vector<test::SolverWay> WaysWithoutAllocations() {
  std::vector<test::SolverWay> ways = test::SolverWays();
  ways.erase(std::remove_if(ways.begin(), ways.end(),
                            [](const test::SolverWay& way) { return way.allocates; }),
             ways.end());
  return ways;
}

INSTANTIATE_TEST_SUITE_P(Ways, RepeatedAllocations, testing::ValuesIn(WaysWithoutAllocations()),
                         test::NameOf);

}  // namespace
}  // namespace inceres
