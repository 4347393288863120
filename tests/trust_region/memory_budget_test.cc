// What does not fit is refused when it is planned, with the figures.
#include "base/memory_budget.h"

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/solver/solver.h"
#include "linearize/memory_prediction.h"
#include "support/random_graph.h"

namespace inceres {
namespace {

using internal::CheckCounts;
using internal::MemoryBudget;
using internal::MemoryExceeded;

std::unique_ptr<test::RandomGraph> Bundle() {
  test::BundleOptions bundle;
  bundle.num_frames = 30;
  bundle.num_landmarks = 400;
  bundle.num_views = 8;
  bundle.frame_sizes = {6};
  bundle.landmark_sizes = {3};
  bundle.residual_sizes = {2};
  bundle.perturbation = 0.01;
  return test::MakeBundle(bundle);
}

SolverOptions Way(int way) {
  SolverOptions options;
  options.linear_model = way < 2 ? LinearModelKind::kSchur : LinearModelKind::kIterativeSchur;
  options.reduced_solver = way == 0 ? ReducedSolverKind::kSparse : ReducedSolverKind::kDense;
  options.conjugate_gradients.preconditioner = PreconditionerKind::kSchurJacobi;
  options.conjugate_gradients.explicit_schur_complement = way == 3;
  options.max_num_iterations = 3;
  return options;
}

TEST(MemoryBudgetOfASolve, OneThatFitsIsSolvedAndATightOneIsRefused) {
  for (int way = 0; way < 4; ++way) {
    const auto fits = Bundle();
    const Summary solved = Solve(Way(way), &fits->graph());
    ASSERT_TRUE(solved.IsSolutionUsable()) << solved.message;
    ASSERT_GT(solved.work.bytes, 100000);

    SolverOptions options = Way(way);
    options.max_memory_bytes = 4 * solved.work.bytes;
    const auto wide = Bundle();
    EXPECT_EQ(Solve(options, &wide->graph()).final_cost, solved.final_cost);

    // Whatever the share, it is refused, and nothing has moved.
    for (const double share : {0.01, 0.3, 0.9}) {
      options.max_memory_bytes =
          static_cast<std::int64_t>(share * static_cast<double>(solved.work.bytes));
      const auto tight = Bundle();
      const std::vector<double> before = tight->graph().state();
      const Summary refused = Solve(options, &tight->graph());
      EXPECT_EQ(refused.termination, Termination::kFailure) << way << ' ' << share;
      EXPECT_NE(refused.message.find("max_memory_bytes is"), std::string::npos) << refused.message;
      EXPECT_TRUE(refused.iterations.empty());
      EXPECT_EQ(tight->graph().state(), before);
    }
  }
}

TEST(MemoryBudgetOfASolve, ARefusedSolveLeavesTheSolverReadyForAnother) {
  const auto bundle = Bundle();
  Solver solver(std::int64_t{1} << 30);
  SolverOptions options = Way(1);
  options.max_memory_bytes = 10000;
  EXPECT_FALSE(solver.Solve(options, &bundle->graph()).IsSolutionUsable());
  options.max_memory_bytes = 0;
  EXPECT_TRUE(solver.Solve(options, &bundle->graph()).IsSolutionUsable());
}

TEST(MemoryBudgetOfASolve, ANegativeOneIsNoOption) {
  SolverOptions options;
  options.max_memory_bytes = -1;
  EXPECT_NE(options.Validate().message.find("max_memory_bytes"), std::string::npos);
}

TEST(MemoryBudget, SaysWhatItIsThatDoesNotFit) {
  MemoryBudget budget(std::int64_t{3} << 30);
  budget.Take(std::int64_t{2} << 30, "the first");
  try {
    budget.Take(std::int64_t{3} << 29, "the second");
    FAIL() << "3.5 GiB of 3";
  } catch (const MemoryExceeded& exceeded) {
    EXPECT_EQ(exceeded.message(),
              "The solve does not fit into memory: with the second (1.5 GiB) it takes 3.5 GiB or "
              "more, and max_memory_bytes is 3.0 GiB.");
  }
}

TEST(MemoryBudget, TheMachineIsAskedOnceAndForLargeSolvesOnly) {
  int asked = 0;
  MemoryBudget budget(0, [&] {
    ++asked;
    return 1e9;
  });
  budget.Take(MemoryBudget::kUnasked - (1 << 21), "what is small");
  EXPECT_EQ(asked, 0);
  budget.Take(900000000, "what fits");
  budget.Take(10, "what fits, too");
  EXPECT_EQ(asked, 1);
  EXPECT_THROW(budget.Take(200000000, "what does not"), MemoryExceeded);
}

TEST(MemoryBudget, CountsBeyond32BitsAreRefused) {
  EXPECT_NO_THROW(CheckCounts(28987644, 2, 2, 6)) << "Final-13682";
  EXPECT_THROW(CheckCounts(600000000, 2, 1, 1), MemoryExceeded) << "connections";
  EXPECT_THROW(CheckCounts(400000000, 2, 6, 1), MemoryExceeded) << "residuals";
  EXPECT_THROW(CheckCounts(200000000, 2, 2, 6), MemoryExceeded) << "Jacobians";
  EXPECT_THROW(CheckCounts(2147483647, 8, 1000, 100000), MemoryExceeded);
}

}  // namespace
}  // namespace inceres
