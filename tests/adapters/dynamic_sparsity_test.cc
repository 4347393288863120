// Ceres's dynamic_sparsity next to stock Ceres: residual blocks that touch all control points of a
// curve, of which three count.
#include <memory>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "adapters/ceres/plan/landmark_selection.h"
#include "adapters/ceres/plan/option_mapping.h"
#include "adapters/compare_with_stock.h"
#include "adapters/test_problems.h"
#include "support/closed_curve.h"

namespace inceres {
namespace {

using testing::BothSolved;
using testing::TestProblem;

std::unique_ptr<TestProblem> MakeCurve(unsigned seed, bool huber) {
  constexpr int kControlPoints = 30;
  const test::ClosedCurveScene scene(seed, kControlPoints, 120);
  auto test = std::make_unique<TestProblem>();
  std::vector<double*> blocks = {nullptr};
  std::vector<int> sizes = {1};
  for (const auto& point : scene.control_points) {
    blocks.push_back(test->Add({point[0], point[1]}));
    sizes.push_back(2);
  }
  for (const auto& observation : scene.observations) {
    blocks[0] = test->Add({observation.t});
    const auto evaluate = [seen = observation.point](const auto& x, double* r, double** J) {
      return test::EvaluateClosedCurve(kControlPoints, seen, x, r, J);
    };
    test->problem.AddResidualBlock(new lambdas::Cost(2, sizes, evaluate),
                                   huber ? new ceres::HuberLoss(0.4) : nullptr, blocks);
  }
  for (std::size_t k = 0; k < kControlPoints; ++k) {
    test->problem.AddResidualBlock(
        new ceres::AutoDiffCostFunction<test::Spring, 2, 2, 2>(new test::Spring), nullptr,
        blocks[k + 1], blocks[(k + 1) % kControlPoints + 1]);
  }
  return test;
}

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
      const BothSolved both = testing::SolveBoth([=] { return MakeCurve(seed, huber); }, Options());
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
  const BothSolved both = testing::SolveBoth([] { return MakeCurve(4, false); }, options);
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
