// Bounds of variables in the batch Solve: the optimum meets its first-order conditions, nothing
// ever leaves them.
#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "inceres/problem/graph_edit.h"
#include "inceres/solver/solver.h"
#include "support/classic_problems.h"
#include "support/dense_oracle.h"
#include "support/random_graph.h"

namespace inceres {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

SolverOptions Tight() {
  SolverOptions options;
  options.max_num_iterations = 300;
  options.function_tolerance = 1e-14;
  options.parameter_tolerance = 1e-14;
  return options;
}

// Checks every point that is evaluated.
class Watch final : public SolveObserver {
 public:
  Watch(const FactorGraph& graph, const std::vector<double>& lower,
        const std::vector<double>& upper)
      : graph_(graph), lower_(lower), upper_(upper) {}
  void BeforeEvaluation(const double* state, bool /*jacobians*/, bool /*new_point*/) override {
    for (std::size_t k = 0; k < graph_.state().size(); ++k) {
      within = within && state[k] >= lower_[k] && state[k] <= upper_[k];
    }
    ++num_evaluations;
  }
  bool within = true;
  int num_evaluations = 0;

 private:
  const FactorGraph& graph_;
  const std::vector<double>& lower_;
  const std::vector<double>& upper_;
};

TEST(BoundedSolve, RosenbrockAgainstAWall) {
  for (const auto interpolation :
       {LineSearchInterpolation::kBisection, LineSearchInterpolation::kQuadratic,
        LineSearchInterpolation::kCubic}) {
    for (const auto strategy :
         {TrustRegionStrategyKind::kLevenbergMarquardt, TrustRegionStrategyKind::kDogleg,
          TrustRegionStrategyKind::kSubspaceDogleg}) {
      FactorGraph graph;
      test::MakeRosenbrock(&graph);
      const std::vector<double> lower = {-2.0, -1.0};
      const std::vector<double> upper = {0.5, 9.0};
      graph.SetBounds(0, lower.data(), upper.data());
      Watch watch(graph, lower, upper);
      SolverOptions options = Tight();
      options.line_search_interpolation = interpolation;
      options.strategy = strategy;
      options.observer = &watch;
      const Summary summary = Solve(options, &graph);
      EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
      EXPECT_TRUE(summary.is_constrained);
      EXPECT_TRUE(watch.within);
      EXPECT_EQ(graph.state()[0], 0.5) << "active, to the last bit";
      // The method clamps steps of the free problem: once at the wall it creeps along it, and may
      // stop before the foot.
      EXPECT_NEAR(graph.state()[1], 0.25, 0.01);
      EXPECT_NEAR(summary.final_cost, 0.125, 2e-3);
      EXPECT_EQ(watch.num_evaluations,
                summary.work.num_residual_evaluations + summary.work.num_jacobian_evaluations);
      EXPECT_NE(summary.ToJson().find("\"is_constrained\": true"), std::string::npos);
    }
  }
}

TEST(BoundedSolve, BoundsThatAreNeverMetDoNotMoveTheMinimum) {
  FactorGraph free;
  test::MakeRosenbrock(&free);
  FactorGraph bounded = free;
  const double lower[] = {-50.0, -kInfinity};
  bounded.SetBounds(0, lower, nullptr);
  Solve(Tight(), &free);
  const Summary summary = Solve(Tight(), &bounded);
  EXPECT_GT(summary.line_search.num_steps, 0);
  EXPECT_GT(summary.line_search.total_seconds, 0.0);
  for (std::size_t k = 0; k < 2; ++k) {
    EXPECT_NEAR(free.state()[k], bounded.state()[k], 1e-6);
  }
}

TEST(BoundedSolve, BundleStaysWithinAndHasTheSameBitsForAnyNumberOfThreads) {
  for (const int num_threads : {1, 3}) {
    test::BundleOptions bundle;
    bundle.perturbation = 0.05;
    auto random = test::MakeBundle(bundle);
    FactorGraph& graph = random->graph();
    std::vector<double> lower(graph.state().size(), -kInfinity);
    std::vector<double> upper(graph.state().size(), kInfinity);
    for (VariableId id = 0; id < graph.num_variables(); ++id) {
      const std::int64_t offset = graph.StateOffset(id);
      if (offset >= 0 && !graph.IsConstant(id)) {
        upper[static_cast<std::size_t>(offset)] = graph.Values(id)[0] + 0.001;
        graph.SetBounds(id, nullptr, upper.data() + offset);
      }
    }
    Watch watch(graph, lower, upper);
    SolverOptions options = Tight();
    options.num_threads = num_threads;
    options.observer = &watch;
    options.gradient_tolerance = 1e-7;
    const Summary summary = Solve(options, &graph);
    EXPECT_TRUE(summary.IsSolutionUsable()) << summary.message;
    EXPECT_TRUE(watch.within);
    EXPECT_LT(summary.final_cost, summary.initial_cost);
    int num_active = 0;
    for (std::size_t k = 0; k < upper.size(); ++k) {
      num_active += graph.state()[k] == upper[k] ? 1 : 0;
    }
    EXPECT_GT(num_active, 0);
    static std::vector<double> one_thread;
    if (num_threads == 1) {
      one_thread = graph.state();
    } else {
      EXPECT_EQ(graph.state(), one_thread) << "the same bits for any number of threads";
    }
  }
}

TEST(BoundedSolve, StartOutsideIsProjectedAndAFailureLeavesIt) {
  FactorGraph graph;
  test::MakeRosenbrock(&graph);
  const double upper[] = {-3.0, 0.5};
  graph.SetBounds(0, nullptr, upper);
  const std::vector<double> start = graph.state();
  SolverOptions options;
  options.max_num_iterations = 0;
  const Summary summary = Solve(options, &graph);
  EXPECT_EQ(graph.state(), (std::vector<double>{-3.0, 0.5}));
  EXPECT_DOUBLE_EQ(summary.initial_cost, 0.5 * (std::pow(10.0 * (0.5 - 9.0), 2) + 16.0));

  class Abort final : public SolveObserver {
    ObserverAction EndOfIteration(const IterationSummary&, const double*) override {
      return ObserverAction::kAbort;
    }
  } abort;
  options.observer = &abort;
  graph.mutable_state() = start;
  EXPECT_EQ(Solve(options, &graph).termination, Termination::kUserFailure);
  EXPECT_EQ(graph.state(), start);
}

TEST(Bounds, AreCopiedLiftedAndGoWithTheVariable) {
  FactorGraph graph;
  test::MakeRosenbrock(&graph);
  EXPECT_FALSE(graph.HasBounds());
  EXPECT_EQ(graph.bounds(0), nullptr);
  const double upper[] = {1.0, kInfinity};
  graph.SetBounds(0, nullptr, upper);
  ASSERT_NE(graph.bounds(0), nullptr);
  EXPECT_EQ(graph.bounds(0)->upper, (std::vector<double>{1.0, kInfinity}));
  EXPECT_EQ(FactorGraph(graph).bounds(0)->upper[0], 1.0);
  const double none[] = {-kInfinity, -std::numeric_limits<double>::max()};
  graph.SetBounds(0, none, nullptr);
  EXPECT_FALSE(graph.HasBounds()) << "none on any side are no bounds";
  graph.SetBounds(0, nullptr, upper);
  GraphEdit edit = GraphEdit(graph);
  edit.RemoveVariable(0);
  ASSERT_TRUE(graph.Apply(edit).ok());
  EXPECT_FALSE(graph.HasBounds());
}

void ExpectRefused(const FactorGraph& graph, const std::string& expected) {
  const Status status = graph.Validate();
  EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
  EXPECT_EQ(status.message, expected);
  FactorGraph copy = graph;
  EXPECT_EQ(Solve(SolverOptions(), &copy).message, expected);
  EXPECT_EQ(copy.state(), graph.state());
}

TEST(Bounds, WhatNothingCanMeetIsNamed) {
  FactorGraph graph;
  test::MakeRosenbrock(&graph);
  const double one[] = {0.0, 1.0};
  graph.SetBounds(0, one, one);
  ExpectRefused(graph,
                "value 0 of variable 0 has the lower bound 0.000000, which is not below its upper "
                "bound 0.000000");
  const double nan[] = {1.0, std::nan("")};
  graph.SetBounds(0, nullptr, nan);
  ExpectRefused(graph, "value 1 of variable 0 has a bound that is not a number");
  graph.SetConstant(0, true);
  const double upper[] = {5.0, 0.5};
  graph.SetBounds(0, nullptr, upper);
  const Status status = graph.Validate();
  EXPECT_NE(
      status.message.find("value 1 of variable 0 is constant at 1.000000, outside its bounds"),
      std::string::npos)
      << status.message;
  const double at[] = {5.0, 1.0};
  graph.SetBounds(0, at, at);
  EXPECT_FALSE(graph.Validate().ok());
  const double exactly[] = {-1.2, 1.0};
  graph.SetBounds(0, exactly, exactly);
  EXPECT_TRUE(graph.Validate().ok()) << "a constant may be pinned";
}

}  // namespace
}  // namespace inceres
