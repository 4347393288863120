// What fails, when, and what is left of it: the case table of Ceres 2.1. State before a failed
// solve = state after it.
#include <cmath>
#include <functional>
#include <limits>
#include <utility>

#include <gtest/gtest.h>

#include "inceres/solver/solver.h"
#include "linear/eigen_ldlt_solver.h"
#include "support/classic_problems.h"
#include "support/dense_oracle.h"
#include "support/random_graph.h"
#include "support/suitesparse_memory.h"

namespace inceres {
namespace {

using test::FunctionFamily;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr char kEvaluationFailed[] = "Residual and Jacobian evaluation failed.";

// Rosenbrock's function, and a second factor that costs nothing until it fails: where
// fails(with_jacobians, n) says so of the n-th evaluation of its kind, counted from 0. All that
// makes an evaluation fail is in linearize/evaluator_failure_test.cc.
class Failing : public testing::TestWithParam<TrustRegionStrategyKind> {
 protected:
  void Build(const std::function<bool(bool, int)>& fails) {
    test::MakeRosenbrock(&graph_);
    start_ = graph_.state();
    const auto family = std::make_shared<FunctionFamily>(
        1, std::vector<FactorFamily::Slot>{{2, 2}},
        [this, fails](int, const double* const*, double* residuals, double** jacobians) {
          residuals[0] = 0.0;
          if (jacobians != nullptr) {
            std::fill_n(jacobians[0], 2, 0.0);
          }
          return !fails(jacobians != nullptr, num_calls_[jacobians != nullptr ? 1 : 0]++);
        });
    graph_.AddFactor(graph_.AddFamily(family), 0, {0});
    options_.strategy = GetParam();
  }

  FactorGraph graph_;
  std::vector<double> start_;
  SolverOptions options_;
  int num_calls_[2] = {0, 0};  // without Jacobians and with them
};

TEST_P(Failing, AtTheStart) {
  Build([](bool with_jacobians, int n) { return with_jacobians && n == 0; });
  const Summary summary = Solve(options_, &graph_);
  EXPECT_EQ(summary.termination, Termination::kFailure);
  EXPECT_EQ(summary.message, kEvaluationFailed);
  EXPECT_NE(summary.detail.find("factor 0 of function (variables 0)"), std::string::npos)
      << summary.detail;
  EXPECT_TRUE(summary.iterations.empty());
  EXPECT_EQ(summary.num_successful_steps, 0);
  EXPECT_EQ(summary.num_unsuccessful_steps, 0);
  EXPECT_EQ(summary.initial_cost, -1.0);
  EXPECT_EQ(summary.final_cost, -1.0);
  EXPECT_EQ(graph_.state(), start_);
}

// A candidate that cannot be evaluated is a rejected step, and the solve goes on to the minimum.
TEST_P(Failing, AtATrialPoint) {
  Build([](bool with_jacobians, int n) { return !with_jacobians && n == 1; });
  const Summary summary = Solve(options_, &graph_);
  EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
  ASSERT_GT(summary.iterations.size(), 2u);
  EXPECT_FALSE(summary.iterations[2].step_is_successful);
  EXPECT_EQ(summary.iterations[2].cost, std::numeric_limits<double>::max());
  EXPECT_LT(summary.iterations[2].trust_region_radius, summary.iterations[1].trust_region_radius);
  EXPECT_NEAR(graph_.state()[0], 1.0, 1e-3);
}

// All progress is discarded when the Jacobian of an accepted point cannot be had.
TEST_P(Failing, AtTheJacobianOfAnAcceptedPoint) {
  Build([](bool with_jacobians, int n) { return with_jacobians && n == 3; });
  const Summary summary = Solve(options_, &graph_);
  EXPECT_EQ(summary.termination, Termination::kFailure);
  EXPECT_EQ(summary.message, kEvaluationFailed);
  EXPECT_NE(summary.detail.find("factor 0 of function"), std::string::npos) << summary.detail;
  EXPECT_EQ(summary.num_successful_steps, 3);
  EXPECT_LT(summary.final_cost, summary.initial_cost);
  EXPECT_EQ(graph_.state(), start_);
}

TEST_P(Failing, EveryTrialPoint) {
  Build([](bool with_jacobians, int) { return !with_jacobians; });
  options_.max_num_iterations = 1000;
  const Summary summary = Solve(options_, &graph_);
  EXPECT_EQ(summary.termination, Termination::kConvergence) << "the radius shrinks to its minimum";
  EXPECT_EQ(summary.num_successful_steps, 1);
  EXPECT_EQ(graph_.state(), start_);
}

INSTANTIATE_TEST_SUITE_P(Strategies, Failing,
                         testing::Values(TrustRegionStrategyKind::kLevenbergMarquardt,
                                         TrustRegionStrategyKind::kDogleg),
                         [](const auto& instance) {
                           return instance.param == TrustRegionStrategyKind::kDogleg
                                      ? "Dogleg"
                                      : "LevenbergMarquardt";
                         });

TEST(InvalidGraphs, FailWithTheMessageOfValidate) {
  FactorGraph graph;
  test::MakePowell(&graph);
  graph.mutable_state()[2] = kNaN;
  const Summary summary = Solve(SolverOptions(), &graph);
  EXPECT_EQ(summary.termination, Termination::kFailure);
  EXPECT_EQ(summary.message, graph.Validate().message);
  EXPECT_NE(summary.message.find("variable 2"), std::string::npos) << summary.message;
  EXPECT_TRUE(summary.iterations.empty());
  EXPECT_EQ(graph.state()[0], 3.0);
  EXPECT_TRUE(std::isnan(graph.state()[2]));
}

TEST(InvalidGraphs, NoTwoLandmarksInAFactor) {
  test::RandomGraph random(1);
  random.Connect(2, {random.AddLandmark(3), random.AddLandmark(3)});
  const std::vector<double> state = random.graph().state();
  const Summary summary = Solve(SolverOptions(), &random.graph());
  EXPECT_EQ(summary.termination, Termination::kFailure);
  EXPECT_NE(summary.message.find("second landmark"), std::string::npos) << summary.message;
  EXPECT_EQ(random.graph().state(), state);
}

TEST(StandingStill, AFactorThatCannotBeEvaluatedFails) {
  FactorGraph graph;
  test::MakeCurveFit(&graph);
  graph.SetConstant(0, true);
  graph.SetConstant(1, true);
  const double huge = 1e6;
  graph.SetValues(0, &huge);  // exp overflows
  const Summary summary = Solve(SolverOptions(), &graph);
  EXPECT_EQ(summary.termination, Termination::kFailure);
  EXPECT_NE(summary.detail.find("not finite"), std::string::npos) << summary.detail;
}

// f = 1 whatever x is: J = 0, no step can lower the model, and five invalid steps in a row end the
// solve.
std::shared_ptr<FunctionFamily> FlatFamily() {
  return test::ScalarFamily(1.0, 0.0);
}

// x ⊞ 0 ≠ x, so the gradient test cannot fire.
class MovingManifold final : public Manifold {
 public:
  int AmbientSize() const override { return 1; }
  int TangentSize() const override { return 1; }
  bool Plus(const double* x, const double* delta, double* out) const override {
    out[0] = x[0] + delta[0] + 1.0;
    return true;
  }
  bool PlusJacobian(const double*, double* J) const override {
    J[0] = 1.0;
    return true;
  }
};

TEST(InvalidSteps, EndTheSolveAndRestoreTheState) {
  const double value = 4.0;
  for (const auto strategy :
       {TrustRegionStrategyKind::kLevenbergMarquardt, TrustRegionStrategyKind::kDogleg}) {
    FactorGraph graph;
    const auto family = FlatFamily();
    graph.AddFactor(
        graph.AddFamily(family), 0,
        {graph.AddVariable(&value, 1, Role::kFrame, std::make_shared<MovingManifold>())});
    SolverOptions options;
    options.strategy = strategy;
    const Summary summary = Solve(options, &graph);
    EXPECT_EQ(summary.termination, Termination::kFailure);
    EXPECT_NE(summary.message.find("max_num_consecutive_invalid_steps: 5"), std::string::npos)
        << summary.message;
    EXPECT_EQ(summary.iterations.size(), 5u) << "the start and four invalid steps";
    EXPECT_FALSE(summary.iterations.back().step_is_valid);
    EXPECT_EQ(summary.iterations.back().cost, 0.5);
    EXPECT_EQ(summary.final_cost, 0.5);
    EXPECT_EQ(graph.state()[0], 4.0);
  }
}

// Refuses every other factorization.
class FlakySolver final : public ReducedSolver {
 public:
  explicit FlakySolver(const char* refusal, int failed_row = -1) : refusal_(refusal) {
    work_.failed_row = failed_row;
  }
  const char* Name() const override { return "flaky"; }
  Status Factorize(const ReducedMatrix& A, const Rows& changed) override {
    return num_calls_++ % 2 == 0 ? Status::Error(StatusCode::kSingular, refusal_)
                                 : solver_.Factorize(A, changed);
  }
  Status Solve(const double* b, const Rows& changed_b, const Truncation& truncation,
               double* x) override {
    return solver_.Solve(b, changed_b, truncation, x);
  }

 private:
  const char* const refusal_;
  int num_calls_ = 0;
  EigenLdltSolver solver_;
};

TEST(InvalidSteps, OnlyThoseInARowCount) {
  FactorGraph graph;
  test::MakeCurveFit(&graph);
  SolverOptions options;
  options.max_num_consecutive_invalid_steps = 2;
  options.reduced_solver_factory = [] { return std::make_unique<FlakySolver>("not this time"); };
  const Summary summary = Solve(options, &graph);
  EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
  EXPECT_GE(summary.num_unsuccessful_steps, 3);
  EXPECT_EQ(summary.detail, "not this time");
  EXPECT_NEAR(graph.state()[0], 0.3, 0.02);
}

// The row that a solver gives by number is named as a variable; its text is its own.
TEST(InvalidSteps, NameTheVariableByTheRowAndNotByTheText) {
  const auto detail_of = [](int failed_row) {
    FactorGraph graph;
    const double unused = 0.0;
    graph.AddVariable(&unused, 1, Role::kFrame);
    test::MakeCurveFit(&graph);
    SolverOptions options;
    options.reduced_solver_factory = [failed_row] {
      return std::make_unique<FlakySolver>("the reduced system is not positive definite at frame 7",
                                           failed_row);
    };
    return Solve(options, &graph).detail;
  };
  EXPECT_EQ(detail_of(-1), "the reduced system is not positive definite at frame 7");
  EXPECT_EQ(detail_of(1), "the reduced system is not positive definite at variable 2");
}

TEST(InvalidSteps, NoGradientIsConvergence) {
  const double value = 4.0;
  FactorGraph graph;
  const auto family = FlatFamily();
  graph.AddFactor(graph.AddFamily(family), 0, {graph.AddVariable(&value, 1, Role::kFrame)});
  EXPECT_EQ(Solve(SolverOptions(), &graph).termination, Termination::kConvergence);
}

// ⊞ undefined at a trial point: a rejected step. Undefined along the gradient: a failure.
class Fence final : public Manifold {
 public:
  explicit Fence(double limit) : limit_(limit) {}
  int AmbientSize() const override { return 1; }
  int TangentSize() const override { return 1; }
  bool Plus(const double* x, const double* delta, double* out) const override {
    out[0] = x[0] + delta[0];
    return std::fabs(delta[0]) <= limit_;
  }
  bool PlusJacobian(const double*, double* J) const override {
    J[0] = 1.0;
    return true;
  }

 private:
  double limit_;
};

Summary SolveFenced(double limit, double slope, FactorGraph* graph) {
  const auto family = test::ScalarFamily([slope](double x) { return slope * (x - 3.0); }, slope);
  const double zero = 0.0;
  graph->AddFactor(graph->AddFamily(family), 0,
                   {graph->AddVariable(&zero, 1, Role::kFrame, std::make_shared<Fence>(limit))});
  return Solve(SolverOptions(), graph);
}

TEST(PlusFails, AtATrialPointIsARejectedStep) {
  FactorGraph graph;
  const Summary summary = SolveFenced(1.0, 0.1, &graph);
  EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
  EXPECT_GT(summary.num_unsuccessful_steps, 0);
  EXPECT_NEAR(graph.state()[0], 3.0, 1e-3);
}

TEST(PlusFails, AlongTheGradientIsAFailure) {
  FactorGraph graph;
  const Summary summary = SolveFenced(1.0, 10.0, &graph);
  EXPECT_EQ(summary.termination, Termination::kFailure);
  EXPECT_EQ(summary.message, "projected_gradient_step = Plus(x, -gradient) failed.");
  EXPECT_EQ(graph.state()[0], 0.0);
}

// A cost that overflows although every residual is finite is not looked at (Ceres up to 2.1): the
// solve ends, nothing moves.
TEST(NotFinite, OverflowingCostEndsWithoutMoving) {
  FactorGraph graph;
  const auto family = test::ScalarFamily([](double x) { return 1e200 * x; }, 1e200);
  const double one = 1.0;
  graph.AddFactor(graph.AddFamily(family), 0, {graph.AddVariable(&one, 1, Role::kFrame)});
  const Summary summary = Solve(SolverOptions(), &graph);
  EXPECT_NE(summary.termination, Termination::kNoConvergence) << summary.message;
  EXPECT_EQ(graph.state()[0], 1.0);
}

// Where a loss has no weight at the start, as √s at a residual of zero, there is no gradient that
// could be below a tolerance.
TEST(NotFinite, AGradientThatIsNoNumberIsNoMinimum) {
  for (const LinearModelKind model :
       {LinearModelKind::kAutomatic, LinearModelKind::kSchur, LinearModelKind::kDenseQr}) {
    FactorGraph graph;
    const auto priors = graph.AddFamily(test::ScalarFamily([](double x) { return x; }, 1.0));
    const double starts[2] = {0.0, 2.5};
    for (const double& start : starts) {
      graph.AddVariable(&start, 1, Role::kFrame);
    }
    graph.AddFactor(priors, 0, {0}, test::LossOfSlope(HUGE_VAL));
    graph.AddFactor(priors, 1, {1});
    SolverOptions options;
    options.linear_model = model;
    const Summary summary = Solve(options, &graph);
    EXPECT_EQ(summary.termination, Termination::kFailure) << summary.message;
    EXPECT_EQ(graph.state()[1], 2.5);
  }
}

// Frames that know the two before them, enough for the sparse factorization, whose order is AMD's.
TEST(OutOfMemory, BeforeTheFirstIterationNothingHasHappened) {
  test::RandomGraph path(1);
  VariableId last = path.AddFrame(6);
  path.Connect(6, {last});
  for (VariableId before = last; path.graph().num_variables() < 100;) {
    const VariableId next = path.AddFrame(6);
    path.Connect(6, {last, next});
    if (before != last) {
      path.Connect(6, {before, next});
    }
    before = std::exchange(last, next);
  }
  path.Perturb(0.1);
  const std::vector<double> start = path.graph().state();
  test::SuiteSparseMemory memory;
  if (!memory.IsReachable()) {
    GTEST_SKIP() << "this SuiteSparse does not let its allocator be replaced";
  }
  memory.Deny();
  const Summary summary = Solve(SolverOptions(), &path.graph());
  memory.Grant();
  EXPECT_EQ(summary.termination, Termination::kFailure);
  EXPECT_NE(summary.message.find("out of memory"), std::string::npos) << summary.message;
  EXPECT_TRUE(summary.iterations.empty());
  EXPECT_EQ(path.graph().state(), start);
  EXPECT_TRUE(Solve(SolverOptions(), &path.graph()).IsSolutionUsable());
}

}  // namespace
}  // namespace inceres
