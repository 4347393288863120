// Why a solve ends when nothing fails: limits, tolerances, nothing to do; and which state it
// returns.
#include <cmath>

#include <gtest/gtest.h>

#include "inceres/solver/solver.h"
#include "support/classic_problems.h"
#include "support/dense_oracle.h"
#include "support/random_graph.h"
#include "trust_region/loop_options.h"

namespace inceres {
namespace {

using test::BundleOptions;
using test::MakeBundle;
using test::RandomGraph;

SolverOptions NoTolerances() {
  SolverOptions options;
  options.function_tolerance = options.gradient_tolerance = options.parameter_tolerance = 0.0;
  return options;
}

bool StartsWith(const std::string& text, const std::string& start) {
  return text.compare(0, start.size(), start) == 0;
}

TEST(Termination, ZeroIterationsEvaluateTheStart) {
  FactorGraph graph;
  test::MakePowell(&graph);
  const std::vector<double> state = graph.state();
  SolverOptions options;
  options.max_num_iterations = 0;
  const Summary summary = Solve(options, &graph);
  EXPECT_EQ(summary.termination, Termination::kNoConvergence);
  EXPECT_EQ(summary.message, "Maximum number of iterations reached. Number of iterations: 0.");
  EXPECT_NEAR(summary.initial_cost, 107.5, 1e-12);
  EXPECT_EQ(summary.final_cost, summary.initial_cost);
  EXPECT_EQ(summary.iterations.size(), 1u);
  EXPECT_EQ(summary.num_successful_steps, 1);
  EXPECT_EQ(summary.num_unsuccessful_steps, 0);
  EXPECT_EQ(summary.work.num_linear_solves, 0);
  EXPECT_EQ(graph.state(), state);
}

TEST(Termination, IterationLimitReturnsTheBestState) {
  const auto bundle = MakeBundle([] {
    BundleOptions options;
    options.perturbation = 1.0;
    return options;
  }());
  SolverOptions options = NoTolerances();
  options.max_num_iterations = 3;
  const Summary summary = Solve(options, &bundle->graph());
  EXPECT_EQ(summary.termination, Termination::kNoConvergence);
  EXPECT_EQ(summary.iterations.size(), 4u);
  EXPECT_NEAR(test::CostAt(bundle->graph(), bundle->graph().state()), summary.final_cost,
              1e-12 * summary.final_cost);
  EXPECT_LT(summary.final_cost, summary.initial_cost);
}

TEST(Termination, NoTimeLeftAfterTheStart) {
  FactorGraph graph;
  test::MakePowell(&graph);
  SolverOptions options;
  options.max_solver_time_in_seconds = 0.0;
  Summary summary = Solve(options, &graph);
  EXPECT_EQ(summary.termination, Termination::kNoConvergence);
  EXPECT_TRUE(StartsWith(summary.message, "Maximum solver time reached.")) << summary.message;
  EXPECT_EQ(summary.iterations.size(), 1u);

  options.max_solver_time_in_seconds = 100.0;
  internal::LoopOptions loop;
  loop.seconds_spent_before = 1000.0;
  Solver solver;
  internal::SolveWith(options, loop, &graph, &solver, &summary);
  EXPECT_EQ(summary.termination, Termination::kNoConvergence);
  EXPECT_GE(summary.iterations.front().cumulative_time_in_seconds, 1000.0);
}

TEST(Termination, GradientTolerance) {
  FactorGraph graph;
  test::MakeRosenbrock(&graph);
  SolverOptions options = NoTolerances();
  options.gradient_tolerance = 1e-3;
  const Summary summary = Solve(options, &graph);
  EXPECT_EQ(summary.termination, Termination::kConvergence);
  EXPECT_TRUE(StartsWith(summary.message, "Gradient tolerance reached.")) << summary.message;
  EXPECT_LE(summary.iterations.back().gradient_max_norm, 1e-3);
  EXPECT_TRUE(summary.iterations.back().step_is_successful);
}

// The candidate that satisfies the tolerance is discarded and leaves no iteration.
TEST(Termination, FunctionToleranceReturnsThePreviousIterate) {
  FactorGraph graph;
  test::MakeCurveFit(&graph);
  SolverOptions options = NoTolerances();
  options.function_tolerance = 1e-3;
  const Summary summary = Solve(options, &graph);
  EXPECT_EQ(summary.termination, Termination::kConvergence);
  EXPECT_TRUE(StartsWith(summary.message, "Function tolerance reached. |cost_change|/cost:"))
      << summary.message;
  EXPECT_NEAR(summary.iterations.back().cost, test::CostAt(graph, graph.state()), 1e-13);
  EXPECT_GT(summary.work.num_residual_evaluations, summary.iterations.back().iteration);
}

// Until a step was accepted the norm of the state counts as unknown: the test cannot fire (Ceres up
// to 2.1).
TEST(Termination, ParameterToleranceOnlyAfterAnAcceptedStep) {
  FactorGraph graph;
  test::MakeCurveFit(&graph);
  SolverOptions options = NoTolerances();
  options.parameter_tolerance = 0.5;
  const Summary summary = Solve(options, &graph);
  EXPECT_EQ(summary.termination, Termination::kConvergence);
  EXPECT_TRUE(StartsWith(summary.message, "Parameter tolerance reached. Relative step_norm:"))
      << summary.message;
  EXPECT_GE(summary.num_successful_steps, 2);
}

TEST(Termination, TrustRegionRadiusAtItsMinimum) {
  // A wrong Jacobian: every step leads uphill.
  FactorGraph graph;
  const auto family = test::ScalarFamily([](double x) { return 10.0 + x; }, -1.0);
  const double zero = 0.0;
  graph.AddFactor(graph.AddFamily(family), 0, {graph.AddVariable(&zero, 1, Role::kFrame)});
  SolverOptions options = NoTolerances();
  options.min_trust_region_radius = 1e-3;
  const Summary summary = Solve(options, &graph);
  EXPECT_EQ(summary.termination, Termination::kConvergence);
  EXPECT_TRUE(StartsWith(summary.message, "Minimum trust region radius reached."))
      << summary.message;
  EXPECT_EQ(summary.num_successful_steps, 1);
  EXPECT_EQ(summary.num_unsuccessful_steps, static_cast<int>(summary.iterations.size()) - 1);
  EXPECT_EQ(graph.state()[0], 0.0);
  EXPECT_EQ(summary.final_cost, summary.initial_cost);
}

TEST(Termination, NothingMoves) {
  RandomGraph random(3);
  const VariableId x = random.AddFrame(3);
  random.Connect(2, {x, random.AddBorrowed(2)});
  random.graph().SetConstant(x, true);
  const double cost = test::CostAt(random.graph(), random.graph().state());
  Summary summary = Solve(SolverOptions(), &random.graph());
  EXPECT_EQ(summary.termination, Termination::kConvergence);
  EXPECT_EQ(summary.message, "Function tolerance reached. No non-constant parameter blocks found.");
  EXPECT_NEAR(summary.initial_cost, cost, 1e-14);
  EXPECT_EQ(summary.final_cost, summary.initial_cost);
  EXPECT_TRUE(summary.iterations.empty());
  EXPECT_EQ(summary.num_successful_steps, -1);
  EXPECT_EQ(summary.num_unsuccessful_steps, -1);

  FactorGraph empty;
  summary = Solve(SolverOptions(), &empty);
  EXPECT_EQ(summary.termination, Termination::kConvergence);
  EXPECT_EQ(summary.final_cost, 0.0);
}

TEST(Termination, LandmarksWithoutFramesToSolveFor) {
  RandomGraph random(3);
  const VariableId still = random.AddFrame(6);
  random.graph().SetConstant(still, true);
  for (int l = 0; l < 10; ++l) {
    const VariableId landmark = random.AddLandmark(3);
    random.Connect(2, {still, landmark});
    random.Connect(3, {still, landmark});
  }
  random.Perturb(0.5);
  const Summary summary = Solve(SolverOptions(), &random.graph());
  EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
  EXPECT_EQ(summary.reduced_solver, "none");
  EXPECT_LT(summary.final_cost, 0.9 * summary.initial_cost);
}

TEST(Termination, UntouchedVariablesAndConstantsKeepTheirValues) {
  const auto bundle = MakeBundle([] {
    BundleOptions options;
    options.num_frames = 9;
    options.constants = true;
    options.perturbation = 0.5;
    return options;
  }());
  FactorGraph& graph = bundle->graph();
  bundle->AddFrame(4);
  const std::vector<double> before = graph.state();
  EXPECT_EQ(Solve(SolverOptions(), &graph).termination, Termination::kConvergence);
  int num_moved = 0;
  for (VariableId id = 0; id < graph.num_variables(); ++id) {
    const auto at = static_cast<std::size_t>(graph.StateOffset(id));
    const bool same = std::equal(before.begin() + graph.StateOffset(id),
                                 before.begin() + graph.StateOffset(id) + graph.AmbientSize(id),
                                 graph.state().begin() + static_cast<std::ptrdiff_t>(at));
    const bool still = graph.IsConstant(id) || id == graph.num_variables() - 1;
    EXPECT_EQ(same, still) << "variable " << id;
    num_moved += same ? 0 : 1;
  }
  EXPECT_GT(num_moved, 10);
}

// With non-monotone steps the last state need not be the best; the best is returned, and the lines
// that rise are marked.
TEST(Termination, NonmonotonicStepsReturnTheCheapestState) {
  bool rose = false;
  for (const auto strategy :
       {TrustRegionStrategyKind::kLevenbergMarquardt, TrustRegionStrategyKind::kDogleg}) {
    for (int limit = 1; limit <= 25; ++limit) {
      FactorGraph graph;
      test::MakeRosenbrock(&graph);
      SolverOptions options = NoTolerances();
      options.strategy = strategy;
      options.use_nonmonotonic_steps = true;
      options.max_num_iterations = limit;
      const Summary summary = Solve(options, &graph);
      ASSERT_TRUE(summary.IsSolutionUsable()) << summary.message;
      double best = summary.initial_cost;
      for (const IterationSummary& iteration : summary.iterations) {
        if (iteration.step_is_successful && iteration.iteration > 0) {
          EXPECT_EQ(iteration.step_is_nonmonotonic, !(iteration.cost < best));
          rose = rose || iteration.step_is_nonmonotonic;
          best = std::min(best, iteration.cost);
        }
      }
      EXPECT_NEAR(test::CostAt(graph, graph.state()), best, 1e-14 + 1e-12 * best);
    }
  }
  EXPECT_TRUE(rose) << "no step ever rose: the test says nothing";
}

}  // namespace
}  // namespace inceres
