// Ceres's dynamic_sparsity next to stock Ceres: residual blocks that touch all control points of a
// curve, of which three count.
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "adapters/ceres/plan/landmark_selection.h"
#include "adapters/ceres/plan/option_mapping.h"
#include "adapters/compare_with_stock.h"
#include "adapters/test_problems.h"

namespace inceres {
namespace {

using testing::BothSolved;
using testing::MakeClosedCurve;

ceres::Solver::Options Options() {
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.dynamic_sparsity = true;
  options.max_num_iterations = 10;
  return options;
}

TEST(DynamicSparsity, TraceIsStocks) {
  for (const unsigned seed : {1U, 2U, 3U}) {
    for (const bool huber : {false, true}) {
      const BothSolved both =
          testing::SolveBoth([=] { return MakeClosedCurve(seed, huber); }, Options());
      EXPECT_FALSE(both.report.used_stock) << both.report.fallback_reason;
      testing::ExpectSameSummary(both, 1e-7, /*same_elimination=*/true);
      testing::ExpectSameParameters(both, 1e-5);
      EXPECT_TRUE(both.report.options_without_effect.empty());
      EXPECT_EQ(both.report.num_landmarks, 0);
      EXPECT_GT(both.ours.iterations.size(), 4U);
    }
  }
}

TEST(DynamicSparsity, TraceIsStocksWithTheDoglegAndTwoThreads) {
  ceres::Solver::Options options = Options();
  options.trust_region_strategy_type = ceres::DOGLEG;
  options.num_threads = 2;
  const BothSolved both = testing::SolveBoth([] { return MakeClosedCurve(4, false); }, options);
  testing::ExpectSameSummary(both, 1e-6, /*same_elimination=*/true);
}

TEST(DynamicSparsity, HasNoEffectInIncrementalMode) {
  ceres::Solver::Options options = Options();
  options.max_num_iterations = ceres::Solver::Options().max_num_iterations;
  EXPECT_EQ(internal::IncrementalOptionsWithoutEffect(options, internal::LandmarkCounts()),
            std::vector<std::string>{"dynamic_sparsity"});
}

}  // namespace
}  // namespace inceres
