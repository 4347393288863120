// The same bits for any number of threads, on every run, and in a solve of a structure that the
// Solver has met: state, costs and every iteration.
#include <cstdint>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/solver/solver.h"
#include "trust_region/same_bits.h"
#include "trust_region/solver_way.h"

namespace inceres {
namespace {

constexpr std::int64_t kRoom = std::int64_t{1} << 30;

class SolverLaws : public testing::TestWithParam<test::SolverWay> {};

TEST_P(SolverLaws, SameBitsForAnyNumberOfThreadsAndInASecondSolve) {
  Solver solver(kRoom);
  SolverOptions options = GetParam().options;
  Summary expected;
  std::vector<double> expected_state;
  for (const int num_threads : {1, 2, 4, 4}) {
    SCOPED_TRACE(std::to_string(num_threads) + " threads");
    const auto graph = GetParam().make(/*other_numbers=*/false);
    options.num_threads = num_threads;
    const Summary summary = solver.Solve(options, graph.get());
    ASSERT_TRUE(summary.IsSolutionUsable()) << summary.message;
    if (expected_state.empty()) {
      EXPECT_GT(summary.num_successful_steps, 2);
      expected = summary;
      expected_state = graph->state();
    }
    test::ExpectSameBits(summary, expected);
    EXPECT_EQ(graph->state(), expected_state);
  }
}

// Nothing is set up again, and no number is remembered.
TEST_P(SolverLaws, ASecondSolveHasTheBitsOfOneFromNothing) {
  Solver solver(kRoom);
  SolverOptions options = GetParam().options;
  options.num_threads = 2;
  for (const bool again : {false, true}) {
    const auto ours = GetParam().make(/*other_numbers=*/again);
    const auto fresh = GetParam().make(/*other_numbers=*/again);
    const Summary summary = solver.Solve(options, ours.get());
    const Summary expected = Solve(options, fresh.get());
    EXPECT_TRUE(expected.IsSolutionUsable()) << expected.message;
    EXPECT_EQ(summary.structure_reused, again && !GetParam().remembers);
    EXPECT_FALSE(expected.structure_reused);
    test::ExpectSameBits(summary, expected);
    EXPECT_EQ(ours->state(), fresh->state());
  }
  EXPECT_GT(solver.Bytes(), 0);
}

INSTANTIATE_TEST_SUITE_P(Ways, SolverLaws, testing::ValuesIn(test::SolverWays()), test::NameOf);

}  // namespace
}  // namespace inceres
