// docs/ceres_contract.md, "Termination and messages". Test names are the conditions'.
#include <cmath>
#include <functional>
#include <limits>
#include <utility>
#include <vector>

#include "conformance/support.h"
#include "support/ceres_manifolds.h"
#include "support/suitesparse_memory.h"

namespace conformance {
namespace {

// `end` is the start of the message; a failure is logged with it.
void ExpectEnd(const Outcome& outcome, ceres::TerminationType type, const std::string& end) {
  EXPECT_EQ(outcome.summary.termination_type, type);
  EXPECT_TRUE(StartsWith(outcome.summary.message, end)) << outcome.summary.message;
  EXPECT_EQ(outcome.summary.IsSolutionUsable(),
            type != ceres::FAILURE && type != ceres::USER_FAILURE);
  EXPECT_EQ(outcome.errors.size(), type == ceres::FAILURE ? 1u : 0u);
  if (type == ceres::FAILURE && !outcome.errors.empty()) {
    EXPECT_EQ(outcome.errors[0], "Terminating: " + outcome.summary.message);
  }
}

TEST(Termination34, gradient) {
  Line line(10.0);
  ExpectEnd(Solve(Small(), &line.problem), ceres::CONVERGENCE,
            "Gradient tolerance reached. Gradient max norm: 0.000000e+00 <= 1.000000e-10");
}

// ‖δ‖/(‖x‖ + tolerance) = 9.4987e-4/(9.99905 + 1e-3)
TEST(Termination34, parameter) {
  Line line;
  Options options = Small();
  options.parameter_tolerance = 1e-3;
  const Outcome outcome = Solve(options, &line.problem);
  ExpectEnd(outcome, ceres::CONVERGENCE, "Parameter tolerance reached. Relative step_norm: 9.498");
  EXPECT_NE(outcome.summary.message.find(" <= 1.000000e-03."), std::string::npos)
      << outcome.summary.message;
}

TEST(Termination34, function) {
  Bundle bundle;
  const Outcome outcome = Solve(Schur(), &bundle.problem);
  ExpectEnd(outcome, ceres::CONVERGENCE, "Function tolerance reached. |cost_change|/cost: ");
  EXPECT_NE(outcome.summary.message.find(" <= 1.000000e-06"), std::string::npos)
      << outcome.summary.message;
}

TEST(Termination34, radius) {
  World world;
  double* x = world.Add({0.5});
  world.problem.AddResidualBlock(OnlyAt(0.5), nullptr, x);
  Options options = Small();
  options.min_trust_region_radius = 5e3;
  ExpectEnd(
      Solve(options, &world.problem), ceres::CONVERGENCE,
      "Minimum trust region radius reached. Trust region radius: 5.000000e+03 <= 5.000000e+03");
}

TEST(Termination34, no_variable_blocks) {
  Line line;
  line.problem.SetParameterBlockConstant(line.x);
  const Outcome outcome = Solve(Small(), &line.problem);
  ExpectEnd(outcome, ceres::CONVERGENCE,
            "Function tolerance reached. No non-constant parameter blocks found.");
  EXPECT_EQ(outcome.summary.message,
            "Function tolerance reached. No non-constant parameter blocks found.");
}

TEST(Termination34, iterations) {
  Line line;
  Options options = Small();
  options.max_num_iterations = 1;
  const Outcome outcome = Solve(options, &line.problem);
  ExpectEnd(outcome, ceres::NO_CONVERGENCE,
            "Maximum number of iterations reached. Number of iterations: 1.");
  EXPECT_EQ(outcome.summary.message,
            "Maximum number of iterations reached. Number of iterations: 1.");
}

TEST(Termination34, time) {
  Line line;
  Options options = Small();
  options.max_solver_time_in_seconds = 0.0;
  const Outcome outcome = Solve(options, &line.problem);
  ExpectEnd(outcome, ceres::NO_CONVERGENCE, "Maximum solver time reached. Total solver time: ");
  EXPECT_NE(outcome.summary.message.find(" >= 0.000000e+00."), std::string::npos)
      << outcome.summary.message;
  EXPECT_EQ(outcome.summary.iterations.size(), 1u);
}

// The order at the end of an iteration: callbacks, time, iteration count, gradient, radius.
TEST(Termination34, order_of_the_tests) {
  Line line(10.0);
  Options options = Small();
  options.min_trust_region_radius = options.initial_trust_region_radius;
  ExpectEnd(Solve(options, &line.problem), ceres::CONVERGENCE, "Gradient tolerance reached.");
  options.max_num_iterations = 0;
  ExpectEnd(Solve(options, &line.problem), ceres::NO_CONVERGENCE,
            "Maximum number of iterations reached.");
  options.max_solver_time_in_seconds = 0.0;
  ExpectEnd(Solve(options, &line.problem), ceres::NO_CONVERGENCE, "Maximum solver time reached.");
  Callback callback(
      [](const ceres::IterationSummary&) { return ceres::SOLVER_TERMINATE_SUCCESSFULLY; });
  options.callbacks.push_back(&callback);
  ExpectEnd(Solve(options, &line.problem), ceres::USER_SUCCESS,
            "User callback returned SOLVER_TERMINATE_SUCCESSFULLY.");
}

TEST(Termination34, evaluation_failed_at_iteration_0) {
  Line line;
  line.problem.AddResidualBlock(new Cost(1, {1}, [](auto...) { return false; }), nullptr, line.x);
  const Outcome outcome = Solve(Small(), &line.problem);
  ExpectEnd(outcome, ceres::FAILURE, kStartFailed);
  EXPECT_EQ(outcome.summary.message, kStartFailed);
}

TEST(Termination34, evaluation_failed_at_an_accepted_step) {
  Line line;
  int num_jacobians = 0;
  auto* cost = new Cost(1, {1}, [&](double const* const*, double* residuals, double** jacobians) {
    residuals[0] = 0.0;
    if (jacobians != nullptr) {
      jacobians[0][0] = 0.0;
    }
    return jacobians == nullptr || ++num_jacobians == 1;
  });
  line.problem.AddResidualBlock(cost, nullptr, line.x);
  const Outcome outcome = Solve(Small(), &line.problem);
  ExpectEnd(outcome, ceres::FAILURE, "Residual and Jacobian evaluation failed.");
  EXPECT_EQ(outcome.summary.iterations.size(), 1u);
  EXPECT_EQ(line.x[0], 0.5);
}

// R² whose Plus fails for some steps.
class Failing : public manifolds::Manifold {
 public:
  explicit Failing(std::function<bool(const double* delta)> fails) : fails_(std::move(fails)) {}
  int AmbientSize() const override { return 2; }
  int TangentSize() const override { return 2; }
  bool Plus(const double* x, const double* delta, double* sum) const override {
    sum[0] = x[0] + delta[0];
    sum[1] = x[1] + delta[1];
    return !fails_(delta);
  }
  bool PlusJacobian(const double*, double* jacobian) const override {
    const double identity[4] = {1.0, 0.0, 0.0, 1.0};
    std::copy(identity, identity + 4, jacobian);
    return true;
  }
  bool Minus(const double*, const double*, double*) const override { return false; }
  bool MinusJacobian(const double*, double*) const override { return false; }

 private:
  std::function<bool(const double* delta)> fails_;
};

TEST(Termination34, plus_of_the_gradient_failed) {
  World world;
  double* x = world.Add({1.0, 2.0});
  world.problem.AddResidualBlock(Target({0.0, 0.0}), nullptr, x);
  manifolds::Set(&world.problem, x, new Failing([](auto) { return true; }));
  const Outcome outcome = Solve(Small(), &world.problem);
  // From 2.2 on whatever fails at the start has one message.
  const std::string message =
      kRelease >= 202 ? kStartFailed : "projected_gradient_step = Plus(x, -gradient) failed.";
  ExpectEnd(outcome, ceres::FAILURE, message);
  EXPECT_EQ(outcome.summary.message, message);
}

// The first call moves along the gradient, the second makes the first candidate, the third moves
// along the gradient there.
TEST(Termination34, plus_of_the_gradient_failed_at_an_accepted_step) {
  World world;
  double* x = world.Add({1.0, 2.0});
  world.problem.AddResidualBlock(Target({0.0, 0.0}), nullptr, x);
  const auto is_third = [num_calls = 0](auto) mutable { return ++num_calls == 3; };
  manifolds::Set(&world.problem, x, new Failing(is_third));
  const Outcome outcome = Solve(Small(), &world.problem);
  ExpectEnd(outcome, ceres::FAILURE, "projected_gradient_step = Plus(x, -gradient) failed.");
  EXPECT_EQ(world.blocks[0], (std::vector<double>{1.0, 2.0})) << "all progress is discarded";
}

TEST(Termination34, bounded_and_plus_of_zero_failed) {
  World world;
  double* x = world.Add({1.0, 2.0});
  world.problem.AddResidualBlock(Target({0.0, 0.0}), nullptr, x);
  const auto is_zero = [](const double* delta) { return delta[0] == 0.0 && delta[1] == 0.0; };
  manifolds::Set(&world.problem, x, new Failing(is_zero));
  world.problem.SetParameterLowerBound(x, 0, -10.0);
  const Outcome outcome = Solve(Small(), &world.problem);
  ExpectEnd(outcome, ceres::FAILURE, "Unable to project initial point onto the feasible set.");
  EXPECT_EQ(outcome.summary.message, "Unable to project initial point onto the feasible set.");
}

TEST(Termination34, invalid_steps) {
  NeverValid world;
  Options options = Small();
  options.gradient_tolerance = 0.0;
  const Outcome outcome = Solve(options, &world.problem);
  const std::string message =
      "Number of consecutive invalid steps more than "
      "Solver::Options::max_num_consecutive_invalid_steps: 5";
  ExpectEnd(outcome, ceres::FAILURE, message);
  EXPECT_EQ(outcome.summary.message, message);
}

// CHOLMOD gets no memory from the end of iteration 0 on. Ours has asked it for the last time by
// then: it goes on.
TEST(Termination34, fatal_linear_solver_error) {
  for (const auto strategy : {ceres::LEVENBERG_MARQUARDT, ceres::DOGLEG}) {
    World world;  // a chain, and long: a sparse factorization is right for it
    for (int i = 0; i < 100; ++i) {
      double* x = world.Add(std::vector<double>(6, 0.1 * i));
      world.problem.AddResidualBlock(Target(std::vector<double>(6, 1.0)), nullptr, x);
      if (i > 0) {
        world.problem.AddResidualBlock(Coupled(6, {6, 6}, i), nullptr,
                                       world.blocks[static_cast<std::size_t>(i - 1)].data(), x);
      }
    }
    const auto start = world.blocks;
    inceres::test::SuiteSparseMemory memory;
    if (!memory.IsReachable()) {
      GTEST_SKIP() << "this SuiteSparse does not let its allocator be replaced";
    }
    Callback callback([&](const ceres::IterationSummary&) {
      memory.Deny();
      return ceres::SOLVER_CONTINUE;
    });
    Options options;
    options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
    options.trust_region_strategy_type = strategy;
    options.callbacks.push_back(&callback);
    const Outcome outcome = Solve(options, &world.problem);
    memory.Grant();
    if (ThisRun() == Way::kActive) {
      ExpectEnd(outcome, ceres::CONVERGENCE, "");
      continue;
    }
    const std::string message =
        "Linear solver failed due to unrecoverable non-numeric causes. Please see the error log "
        "for clues. ";
    ExpectEnd(outcome, ceres::FAILURE, message);
    EXPECT_EQ(outcome.summary.message, message);
    EXPECT_EQ(outcome.summary.iterations.size(), 1u);
    EXPECT_EQ(outcome.summary.num_successful_steps, 1);
    EXPECT_EQ(outcome.summary.num_unsuccessful_steps, 0);
    EXPECT_EQ(outcome.summary.num_linear_solves, 1);
    EXPECT_EQ(world.blocks, start);
  }
}

}  // namespace
}  // namespace conformance
