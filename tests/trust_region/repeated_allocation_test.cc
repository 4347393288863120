// A second solve of a structure asks for no memory at all, of whatever library.
#include <cstdint>

#include <gtest/gtest.h>

#include "inceres/solver/solver.h"
#include "support/allocations.h"
#include "trust_region/solver_way.h"

namespace inceres {
namespace {

using test::MakeBundle;
using Way = test::SolverWay;

class RepeatedAllocations : public testing::TestWithParam<Way> {
 protected:
  static SolverOptions Iterations(int count) {
    SolverOptions options;
    GetParam().Choose(&options);
    options.max_num_iterations = count;
    options.function_tolerance = options.gradient_tolerance = options.parameter_tolerance = 0.0;
    return options;
  }
  // Allocations of a solve of `graph`.
  std::int64_t Count(const SolverOptions& options, FactorGraph* graph) {
    const std::int64_t before = test::NumAllocations();
    solver_.Solve(options, graph, &summary_);
    const std::int64_t count = test::NumAllocations() - before;
    EXPECT_TRUE(summary_.IsSolutionUsable()) << summary_.message;
    return count;
  }
  Solver solver_;
  Summary summary_;
};

TEST_P(RepeatedAllocations, NoneInASecondSolve) {
  if (!test::CanCountAllocations()) {
    GTEST_SKIP() << "this build has an allocator of its own";
  }
  // Jacobians that are not kept are of several chunks.
  const int num_landmarks = GetParam().recomputes_jacobians ? 8000 : 300;
  const auto first = MakeBundle(test::MixedBundle(num_landmarks));
  const auto second = MakeBundle(test::MixedBundle(num_landmarks));
  EXPECT_GT(Count(Iterations(20), &first->graph()), 100);  // or the counter counts nothing
  EXPECT_FALSE(summary_.structure_reused);
  {
    const test::AllocationTrap trap;
    EXPECT_EQ(Count(Iterations(15), &second->graph()), 0);
  }
  EXPECT_TRUE(summary_.structure_reused);
  EXPECT_EQ(summary_.iterations.size(), 16u);
  EXPECT_GT(summary_.num_successful_steps, 3);
}

INSTANTIATE_TEST_SUITE_P(
    Ways, RepeatedAllocations,
    testing::Values(Way{"Schur", LinearModelKind::kSchur, ReducedSolverKind::kDense,
                        TrustRegionStrategyKind::kLevenbergMarquardt, 1},
                    Way{"SchurDogleg", LinearModelKind::kSchur, ReducedSolverKind::kDense,
                        TrustRegionStrategyKind::kDogleg, 1},
                    Way{"SchurSparse", LinearModelKind::kSchur, ReducedSolverKind::kSparse,
                        TrustRegionStrategyKind::kLevenbergMarquardt, 1},
                    Way{"SchurTwoThreads", LinearModelKind::kSchur, ReducedSolverKind::kDense,
                        TrustRegionStrategyKind::kLevenbergMarquardt, 2},
                    Way{"SchurRecomputed", LinearModelKind::kSchur, ReducedSolverKind::kDense,
                        TrustRegionStrategyKind::kLevenbergMarquardt, 2, true},
                    Way{"Plain", LinearModelKind::kPlain, ReducedSolverKind::kDense,
                        TrustRegionStrategyKind::kLevenbergMarquardt, 1}),
    test::NameOf);

}  // namespace
}  // namespace inceres
