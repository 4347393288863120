// The same bits for any number of threads and on every run: state, costs and every iteration.
#include <string>

#include <gtest/gtest.h>

#include "inceres/solver/solver.h"
#include "support/random_graph.h"
#include "trust_region/same_bits.h"

namespace inceres {
namespace {

using test::BundleOptions;
using test::ExpectSameBits;
using test::MakeBundle;

BundleOptions LargeBundle() {
  BundleOptions options;
  options.num_frames = 40;
  options.num_landmarks = 900;
  options.frame_sizes = {6, 9};
  options.landmark_sizes = {3, 1};
  options.losses = options.manifolds = options.constants = true;
  options.perturbation = 0.5;
  return options;
}

class SameBits : public testing::TestWithParam<TrustRegionStrategyKind> {
 protected:
  Summary SolveWith(int num_threads, ReducedSolverKind kind, std::vector<double>* state) const {
    const auto bundle = MakeBundle(LargeBundle());
    SolverOptions options;
    options.strategy = GetParam();
    options.reduced_solver = kind;
    options.num_threads = num_threads;
    options.max_num_iterations = 6;
    Summary summary = Solve(options, &bundle->graph());
    EXPECT_TRUE(summary.IsSolutionUsable()) << summary.message;
    *state = bundle->graph().state();
    return summary;
  }
};

TEST_P(SameBits, ForAnyNumberOfThreadsAndEveryRun) {
  for (const auto kind :
       {ReducedSolverKind::kDense, ReducedSolverKind::kSparse, ReducedSolverKind::kPcg}) {
    std::vector<double> expected_state;
    const Summary expected = SolveWith(1, kind, &expected_state);
    for (const int num_threads : {1, 2, 4, 2}) {
      SCOPED_TRACE(std::string(expected.reduced_solver) + ", " + std::to_string(num_threads) +
                   " threads");
      std::vector<double> state;
      ExpectSameBits(SolveWith(num_threads, kind, &state), expected);
      EXPECT_EQ(state, expected_state);
    }
  }
}

std::string StrategyName(const testing::TestParamInfo<TrustRegionStrategyKind>& info) {
  const char* names[] = {"LevenbergMarquardt", "Marquardt", "Dogleg", "SubspaceDogleg"};
  return names[static_cast<int>(info.param)];
}

INSTANTIATE_TEST_SUITE_P(Strategies, SameBits,
                         testing::Values(TrustRegionStrategyKind::kLevenbergMarquardt,
                                         TrustRegionStrategyKind::kMarquardt,
                                         TrustRegionStrategyKind::kDogleg,
                                         TrustRegionStrategyKind::kSubspaceDogleg),
                         StrategyName);

}  // namespace
}  // namespace inceres
