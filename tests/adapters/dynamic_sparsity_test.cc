// Ceres's dynamic_sparsity next to stock Ceres: residual blocks that touch all control points of a
// curve, of which three count.
#include <algorithm>
#include <cmath>
#include <memory>
#include <random>
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
using testing::TestProblem;

// A closed polygon at t, less an observation. Blocks: t, then all corners, of which two count.
class PolygonCost final : public ceres::CostFunction {
 public:
  PolygonCost(int num_corners, double x, double y) : observation_{x, y} {
    set_num_residuals(2);
    mutable_parameter_block_sizes()->assign(static_cast<std::size_t>(num_corners) + 1, 2);
    mutable_parameter_block_sizes()->front() = 1;
  }

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    const int n = static_cast<int>(parameter_block_sizes().size()) - 1;
    const double t = parameters[0][0] - n * std::floor(parameters[0][0] / n);
    const int a = std::min(static_cast<int>(t), n - 1);
    const double weights[2] = {1.0 - (t - a), t - a};
    const int slots[2] = {1 + a, 1 + (a + 1) % n};
    for (int k = 1; jacobians != nullptr && k <= n; ++k) {
      if (jacobians[k] != nullptr) {
        std::fill_n(jacobians[k], 4, 0.0);
      }
    }
    for (int d = 0; d < 2; ++d) {
      residuals[d] = weights[0] * parameters[slots[0]][d] + weights[1] * parameters[slots[1]][d] -
                     observation_[d];
      if (jacobians != nullptr && jacobians[0] != nullptr) {
        jacobians[0][d] = parameters[slots[1]][d] - parameters[slots[0]][d];
      }
      for (int k = 0; jacobians != nullptr && k < 2; ++k) {
        if (jacobians[slots[k]] != nullptr) {
          jacobians[slots[k]][3 * d] = weights[k];
        }
      }
    }
    return true;
  }

 private:
  double observation_[2];
};

struct Spring {
  template <typename T>
  bool operator()(const T* a, const T* b, T* residuals) const {
    residuals[0] = 0.1 * (a[0] - b[0]);
    residuals[1] = 0.1 * (a[1] - b[1]);
    return true;
  }
};

std::unique_ptr<TestProblem> MakePolygon(unsigned seed, bool huber) {
  constexpr int kCorners = 30;
  constexpr int kObservations = 120;
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  auto test = std::make_unique<TestProblem>();
  std::vector<double*> blocks = {nullptr};
  for (int k = 0; k < kCorners; ++k) {
    const double angle = 2.0 * M_PI * k / kCorners;
    blocks.push_back(test->Add({3.0 * std::cos(angle), 3.0 * std::sin(angle)}));
  }
  for (int i = 0; i < kObservations; ++i) {
    const double angle = 2.0 * M_PI * i / kObservations;
    blocks[0] = test->Add({kCorners * (angle / (2.0 * M_PI)) + 0.4 * normal(random)});
    test->problem.AddResidualBlock(
        new PolygonCost(kCorners, 4.0 * std::cos(angle) + 0.05 * normal(random),
                        2.0 * std::sin(angle) + 0.05 * normal(random)),
        huber ? new ceres::HuberLoss(0.4) : nullptr, blocks);
  }
  for (int k = 0; k < kCorners; ++k) {
    test->problem.AddResidualBlock(new ceres::AutoDiffCostFunction<Spring, 2, 2, 2>(new Spring),
                                   nullptr, blocks[static_cast<std::size_t>(k) + 1],
                                   blocks[static_cast<std::size_t>((k + 1) % kCorners) + 1]);
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
      const BothSolved both =
          testing::SolveBoth([=] { return MakePolygon(seed, huber); }, Options());
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
  const BothSolved both = testing::SolveBoth([] { return MakePolygon(4, false); }, options);
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
