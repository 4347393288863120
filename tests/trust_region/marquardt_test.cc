// Marquardt's rule: steps that are cut before a border, and steps that are too long for their
// model.

#include <algorithm>
#include <memory>

#include <gtest/gtest.h>

#include "inceres/solver/solver.h"
#include "support/test_families.h"

namespace inceres {
namespace {

using test::FunctionFamily;

// One variable, from `start`.
Summary SolveLine(TrustRegionStrategyKind strategy, const std::shared_ptr<FunctionFamily>& of_x,
                  double* x) {
  FactorGraph graph;
  const auto family = graph.AddFamily(of_x);
  const VariableId id = graph.AddVariable(x, 1, Role::kFrame);
  graph.AddFactor(family, 0, {id});
  SolverOptions options;
  options.strategy = strategy;
  options.function_tolerance = 1e-12;
  options.max_num_iterations = 12;
  const Summary summary = Solve(options, &graph);
  *x = graph.state()[0];
  return summary;
}

double LeastShare(const Summary& summary) {
  double least = 1.0;
  for (const IterationSummary& iteration : summary.iterations) {
    least = std::min(least, iteration.step_share);
  }
  return least;
}

// A minimum at 2, and nothing beyond 1.
std::shared_ptr<FunctionFamily> Bordered() {
  return test::JetFamily<1, 1>([](const auto* x, auto* f) {
    f[0] = x[0] - 2.0;
    return x[0] <= 1.0;
  });
}

TEST(Marquardt, GoesUpToABorder) {
  double x = 0.0;
  const Summary summary = SolveLine(TrustRegionStrategyKind::kMarquardt, Bordered(), &x);
  ASSERT_TRUE(summary.IsSolutionUsable()) << summary.message;
  EXPECT_LE(x, 1.0);
  EXPECT_GT(x, 1.0 - 1e-4);
  EXPECT_LT(LeastShare(summary), 1.0);
  double other = 0.0;
  SolveLine(TrustRegionStrategyKind::kLevenbergMarquardt, Bordered(), &other);
  EXPECT_LT(other, x) << "it only has more damping to keep steps short";
}

// ½ x² + ½ (1.2 + 0.6 x²)²: at the minimum, 0, the cost is 2.44 times as curved as its model, so
// that Gauss-Newton steps lead away from it.
std::shared_ptr<FunctionFamily> Curved() {
  return test::JetFamily<2, 1>([](const auto* x, auto* f) {
    f[0] = x[0];
    f[1] = 1.2 + 0.6 * x[0] * x[0];
  });
}

TEST(Marquardt, ShortensStepsThatAreTooLong) {
  double x = 0.5;
  const Summary summary = SolveLine(TrustRegionStrategyKind::kMarquardt, Curved(), &x);
  EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
  EXPECT_NEAR(x, 0.0, 1e-5);
  EXPECT_LT(LeastShare(summary), 1.0);
  EXPECT_EQ(summary.num_unsuccessful_steps, 0);
}

// Exact mode takes steps whole.
TEST(Marquardt, IsTheOnlyRuleThatDoes) {
  for (const auto& family : {Bordered(), Curved()}) {
    double x = 0.5;
    const Summary summary = SolveLine(TrustRegionStrategyKind::kLevenbergMarquardt, family, &x);
    EXPECT_EQ(LeastShare(summary), 1.0);
  }
}

}  // namespace
}  // namespace inceres
