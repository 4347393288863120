// Known minima are found, by both strategies and every linear model.
#include <cmath>
#include <cstddef>
#include <memory>
#include <string>
#include <tuple>

#include <gtest/gtest.h>

#include "inceres/problem/losses.h"
#include "inceres/solver/solver.h"
#include "linearize/layout.h"
#include "support/classic_problems.h"
#include "support/dense_oracle.h"
#include "support/random_graph.h"
#include "support/test_families.h"

namespace inceres {
namespace {

using test::BundleOptions;
using test::MakeBundle;

using Configuration = std::tuple<TrustRegionStrategyKind, LinearModelKind>;

class Converges : public testing::TestWithParam<Configuration> {
 protected:
  Converges() {
    options_.strategy = std::get<0>(GetParam());
    options_.linear_model = std::get<1>(GetParam());
    options_.max_num_iterations = 200;
    options_.function_tolerance = 1e-15;
    options_.gradient_tolerance = 1e-12;
    options_.parameter_tolerance = 1e-12;
  }

  Summary SolveToConvergence(FactorGraph* graph) {
    Summary summary = Solve(options_, graph);
    EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
    EXPECT_EQ(summary.num_successful_steps + summary.num_unsuccessful_steps,
              static_cast<int>(summary.iterations.size()));
    EXPECT_NEAR(summary.iterations.front().cost, summary.initial_cost, 0.0);
    EXPECT_LE(summary.final_cost, summary.initial_cost);
    return summary;
  }

  SolverOptions options_;
};

TEST_P(Converges, Powell) {
  FactorGraph graph;
  test::MakePowell(&graph);
  const Summary summary = SolveToConvergence(&graph);
  EXPECT_NEAR(summary.initial_cost, 107.5, 1e-12);  // ½ (7² + 5 + 1 + 10 · 2⁴)
  EXPECT_LT(summary.final_cost, 1e-12);
  for (const double x : graph.state()) {
    EXPECT_NEAR(x, 0.0, 5e-3);
  }
}

TEST_P(Converges, Rosenbrock) {
  FactorGraph graph;
  test::MakeRosenbrock(&graph);
  EXPECT_LT(SolveToConvergence(&graph).final_cost, 1e-20);
  EXPECT_NEAR(graph.state()[0], 1.0, 1e-8);
  EXPECT_NEAR(graph.state()[1], 1.0, 1e-8);
}

TEST_P(Converges, CurveFit) {
  FactorGraph graph;
  test::MakeCurveFit(&graph);
  SolveToConvergence(&graph);
  EXPECT_NEAR(graph.state()[0], 0.3, 0.02);
  EXPECT_NEAR(graph.state()[1], 0.1, 0.1);
  EXPECT_LT(test::DenseOracle(graph, {0, 1}).g.norm(), 1e-5);
}

TEST_P(Converges, CurveFitWithOutliersNeedsTheLoss) {
  FactorGraph plain;
  test::MakeCurveFit(&plain, nullptr, /*outliers=*/true);
  SolveToConvergence(&plain);
  FactorGraph robust;
  test::MakeCurveFit(&robust, std::make_shared<CauchyLoss>(0.2), /*outliers=*/true);
  SolveToConvergence(&robust);
  EXPECT_GT(std::fabs(plain.state()[0] - 0.3), 0.02);
  EXPECT_LT(std::fabs(robust.state()[0] - 0.3), 0.02);
}

// To the same minimum in fewer steps, each of which keeps closer to its promise.
TEST(ReduceCurvatureOfLosses, TakesFewerIterations) {
  const auto solve = [](bool reduces) {
    FactorGraph graph;
    test::MakeCurveFit(&graph, std::make_shared<CauchyLoss>(0.05), /*outliers=*/true);
    SolverOptions options;
    options.reduce_curvature_of_losses = reduces;
    options.function_tolerance = 1e-14;
    options.max_num_iterations = 200;
    return Solve(options, &graph);
  };
  const Summary as_ceres = solve(false);
  const Summary reduced = solve(true);
  EXPECT_EQ(reduced.termination, Termination::kConvergence);
  EXPECT_NEAR(reduced.final_cost, as_ceres.final_cost, 1e-10 * as_ceres.final_cost);
  EXPECT_LT(reduced.iterations.size(), as_ceres.iterations.size());
}

// One residual x with a loss, and a wall that the model does not see: what a step is long by tells
// the curvature that it was found with.
TEST(ReduceCurvatureOfLosses, ARefusedStepIsFollowedByOneOfTheModelWithout) {
  FactorGraph graph;
  const double start = 29.5;
  const VariableId x = graph.AddVariable(&start, 1, Role::kFrame);
  const auto residual =
      graph.AddFamily(test::JetFamily<1, 1>([](const auto* v, auto* f) { f[0] = v[0]; }));
  graph.AddFactor(residual, 0, {x}, std::make_shared<CauchyLoss>(1.0));
  const auto wall = graph.AddFamily(test::JetFamily<1, 1>(
      [](const auto* v, auto* f) { f[0] = v[0] < 29.0 ? 1e3 * (29.0 - v[0]) : 0.0 * v[0]; }));
  graph.AddFactor(wall, 0, {x});
  SolverOptions options;
  options.reduce_curvature_of_losses = true;
  options.initial_trust_region_radius = 1e-3;
  options.function_tolerance = 1e-7;
  const Summary summary = Solve(options, &graph);
  int num_after_refusal = 0;
  int num_long = 0;
  for (std::size_t i = 2; i < summary.iterations.size(); ++i) {
    const IterationSummary& before = summary.iterations[i - 1];
    const double g = before.gradient_max_norm;  // x / (1 + x²)
    const double at = (1.0 + std::sqrt(1.0 - 4.0 * g * g)) / (2.0 * g);
    const double undamped =
        summary.iterations[i].step_norm * (1.0 + 1.0 / before.trust_region_radius);
    if (!before.step_is_successful) {
      EXPECT_NEAR(undamped, at, 1e-6 * at) << "iteration " << i;
      ++num_after_refusal;
    } else {
      num_long += undamped > 1.5 * at ? 1 : 0;
    }
  }
  EXPECT_GT(num_after_refusal, 1);
  EXPECT_GT(num_long, 1);
}

std::string ConfigurationName(const testing::TestParamInfo<Configuration>& info) {
  const char* models[] = {"Automatic", "Schur", "Plain", "DenseQr"};
  const char* strategies[] = {"LevenbergMarquardt", "Marquardt", "Dogleg", "SubspaceDogleg"};
  return std::string(strategies[static_cast<int>(std::get<0>(info.param))]) +
         models[static_cast<int>(std::get<1>(info.param))];
}

INSTANTIATE_TEST_SUITE_P(
    Configurations, Converges,
    testing::Combine(testing::Values(TrustRegionStrategyKind::kLevenbergMarquardt,
                                     TrustRegionStrategyKind::kMarquardt,
                                     TrustRegionStrategyKind::kDogleg,
                                     TrustRegionStrategyKind::kSubspaceDogleg),
                     testing::Values(LinearModelKind::kAutomatic, LinearModelKind::kSchur,
                                     LinearModelKind::kPlain, LinearModelKind::kDenseQr)),
    ConfigurationName);

class BundleConverges : public testing::TestWithParam<int> {};  // landmark size

// Every combination of strategy, model and reduced solver ends in the same minimum, and it is one.
TEST_P(BundleConverges, ToTheSameMinimumWhateverSolves) {
  BundleOptions bundle;
  bundle.num_frames = 10;
  bundle.num_landmarks = 40;
  bundle.num_views = 5;
  bundle.landmark_sizes = {GetParam()};
  bundle.residual_sizes = {2, 3};
  bundle.losses = bundle.constants = bundle.hosted = true;
  bundle.perturbation = 0.3;
  double minimum = -1.0;
  for (const auto strategy :
       {TrustRegionStrategyKind::kLevenbergMarquardt, TrustRegionStrategyKind::kDogleg}) {
    for (const auto model :
         {LinearModelKind::kAutomatic, LinearModelKind::kPlain, LinearModelKind::kDenseQr}) {
      for (const auto reduced : {ReducedSolverKind::kAutomatic, ReducedSolverKind::kSparse}) {
        const auto graph = MakeBundle(bundle);
        SolverOptions options;
        options.strategy = strategy;
        options.linear_model = model;
        options.reduced_solver = reduced;
        options.function_tolerance = 1e-14;
        options.max_num_iterations = 500;
        const Summary summary = Solve(options, &graph->graph());
        ASSERT_EQ(summary.termination, Termination::kConvergence) << summary.message;
        minimum = minimum < 0.0 ? summary.final_cost : minimum;
        EXPECT_NEAR(summary.final_cost, minimum, 1e-9 * minimum);
        EXPECT_NEAR(summary.final_cost, test::CostAt(graph->graph(), graph->graph().state()),
                    1e-9 * minimum);
        const internal::Layout layout(graph->graph(), true);
        EXPECT_LT(test::DenseOracle(graph->graph(), layout.variables).g.norm(), 1e-4);
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(LandmarkSizes, BundleConverges, testing::Values(1, 2, 3, 4));

TEST(Work, CountsWhatWasDone) {
  BundleOptions bundle;
  bundle.perturbation = 0.3;
  const auto graph = MakeBundle(bundle);
  const Summary summary = Solve(SolverOptions(), &graph->graph());
  EXPECT_EQ(summary.work.num_frames, 6);
  EXPECT_EQ(summary.work.num_landmarks, 30);
  EXPECT_EQ(summary.work.reduced_size, 36);
  EXPECT_EQ(summary.work.num_schur_products, 30 * 6);  // three frames see each landmark
  EXPECT_EQ(summary.work.num_jacobian_evaluations, summary.num_successful_steps);
  EXPECT_GE(summary.work.num_residual_evaluations, summary.num_successful_steps - 1);
  EXPECT_GT(summary.work.bytes, 0);
  EXPECT_GT(summary.seconds.total, 0.0);
}

}  // namespace
}  // namespace inceres
