// Where releases of Ceres differ in the loop: CeresRules.
#include <array>
#include <cmath>
#include <limits>
#include <memory>

#include <gtest/gtest.h>

#include "inceres/solver/solver.h"
#include "support/classic_problems.h"
#include "support/test_families.h"
#include "trust_region/loop_options.h"

namespace inceres {
namespace {

using internal::CeresRules;

// ½ (scale (x − 1))² from x = 3.
void MakeLine(double scale, std::shared_ptr<const Loss> loss, FactorGraph* graph) {
  const auto family = test::ScalarFamily([scale](double x) { return scale * (x - 1.0); }, scale);
  const double start = 3.0;
  graph->AddFactor(graph->AddFamily(family), 0, {graph->AddVariable(&start, 1, Role::kFrame)},
                   std::move(loss));
}

// Not a number inside a ring around the minimum, which the first steps of a small radius do not
// reach.
std::shared_ptr<const Loss> LossWithAHole() {
  return test::LossOf([](double s) {
    const bool hole = s > 0.01 && s < 1.0;
    return std::array{hole ? std::numeric_limits<double>::quiet_NaN() : s, 1.0, 0.0};
  });
}

Summary SolveBy(CeresRules rules, const SolverOptions& options, FactorGraph* graph) {
  internal::LoopOptions loop;
  loop.rules = rules;
  Solver solver;
  Summary summary;
  internal::SolveWith(options, loop, graph, &solver, &summary);
  return summary;
}

TEST(CeresRules, StartOfInfiniteCost) {
  for (const CeresRules rules : {CeresRules::k21, CeresRules::k22}) {
    FactorGraph graph;
    MakeLine(1e200, nullptr, &graph);
    const Summary summary = SolveBy(rules, SolverOptions(), &graph);
    EXPECT_EQ(graph.state()[0], 3.0);
    if (rules == CeresRules::k22) {
      EXPECT_EQ(summary.termination, Termination::kFailure);
      EXPECT_EQ(summary.message, "Initial residual and Jacobian evaluation failed.");
      EXPECT_EQ(summary.detail, "the sum of all costs is not finite");
      EXPECT_TRUE(summary.iterations.empty());
    } else {
      EXPECT_NE(summary.message, "Initial residual and Jacobian evaluation failed.");
      EXPECT_FALSE(summary.iterations.empty());
    }
  }
}

// The second step falls into the hole: up to 2.1 that is convergence, from 2.2 on a rejected step,
// after which shorter ones go on.
TEST(CeresRules, TrialPointWithoutANumber) {
  SolverOptions options;
  options.initial_trust_region_radius = 1.0;
  options.max_num_iterations = 10;
  for (const CeresRules rules : {CeresRules::k21, CeresRules::k22}) {
    FactorGraph graph;
    MakeLine(1.0, LossWithAHole(), &graph);
    const Summary summary = SolveBy(rules, options, &graph);
    if (rules == CeresRules::k22) {
      EXPECT_GT(summary.num_unsuccessful_steps, 0);
      EXPECT_EQ(summary.iterations[2].cost, std::numeric_limits<double>::max());
    } else {
      EXPECT_EQ(summary.termination, Termination::kConvergence);
      EXPECT_NE(summary.message.find("nan"), std::string::npos) << summary.message;
      EXPECT_EQ(summary.num_unsuccessful_steps, 0);
    }
  }
}

// Below the tolerance where Ceres is followed to the letter; of the core's own solves it is no
// minimum.
TEST(CeresRules, GradientThatIsNoNumber) {
  for (const double slope : {-1.0, std::numeric_limits<double>::quiet_NaN()}) {
    for (const bool as_ceres : {false, true}) {
      FactorGraph graph;
      MakeLine(1.0, test::LossOfSlope(slope), &graph);
      internal::LoopOptions loop;
      loop.nan_gradient_is_small = as_ceres;
      Solver solver;
      Summary summary;
      internal::SolveWith(SolverOptions(), loop, &graph, &solver, &summary);
      EXPECT_EQ(summary.termination, as_ceres ? Termination::kConvergence : Termination::kFailure)
          << summary.message;
      EXPECT_EQ(summary.message.find("Gradient max norm: nan <= ") != std::string::npos, as_ceres);
      EXPECT_EQ(graph.state()[0], 3.0);
    }
  }
}

// With bounds the norm of the start is known, so up to 2.1 the tolerance can be met by the very
// first step.
TEST(CeresRules, ParameterToleranceBeforeTheFirstAcceptedStep) {
  SolverOptions options;
  options.parameter_tolerance = 0.9;
  options.function_tolerance = options.gradient_tolerance = 0.0;
  for (const CeresRules rules : {CeresRules::k21, CeresRules::k22}) {
    for (const bool bounded : {false, true}) {
      FactorGraph graph;
      MakeLine(1.0, nullptr, &graph);
      const double wall = -100.0;
      const double none = std::numeric_limits<double>::infinity();
      if (bounded) {
        graph.SetBounds(0, &wall, &none);
      }
      const Summary summary = SolveBy(rules, options, &graph);
      const bool at_once = rules == CeresRules::k21 && bounded;
      EXPECT_EQ(summary.num_successful_steps, at_once ? 1 : 2) << "the start counts as one";
      EXPECT_EQ(summary.message.rfind("Parameter tolerance reached.", 0), 0u) << summary.message;
    }
  }
}

TEST(CeresRules, StepNormBeforeTheFirstAcceptedStep) {
  SolverOptions options;
  options.initial_trust_region_radius = 1.0;
  options.max_num_iterations = 2;
  options.function_tolerance = options.gradient_tolerance = options.parameter_tolerance = 0.0;
  for (const CeresRules rules : {CeresRules::k21, CeresRules::k22}) {
    FactorGraph graph;
    test::MakeRosenbrock(&graph);
    const Summary summary = SolveBy(rules, options, &graph);
    ASSERT_EQ(summary.iterations.size(), 3u);
    ASSERT_TRUE(summary.iterations[1].step_is_successful);
    EXPECT_EQ(summary.iterations[1].step_norm == 0.0, rules == CeresRules::k22);
    EXPECT_GT(summary.iterations[2].step_norm, 0.0);
  }
}

}  // namespace
}  // namespace inceres
