// docs/ceres_contract.md, "Case table", continued: costs that overflow, ends by the user and by
// limits, bounds.
#include <chrono>
#include <cmath>
#include <limits>
#include <thread>

#include "conformance/support.h"

namespace conformance {
namespace {

// A cost that is no number: up to Ceres 2.1 every difference from it is within the tolerance, from
// 2.2 on it cannot be evaluated.
void ExpectEndAtNoNumber(const Summary& summary) {
  if (kRelease >= 202) {
    EXPECT_EQ(summary.termination_type, ceres::FAILURE);
    EXPECT_EQ(summary.message, kStartFailed);
    EXPECT_EQ(summary.initial_cost, -1.0);
  } else {
    EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE);
    EXPECT_TRUE(StartsWith(summary.message, "Function tolerance reached. |cost_change|/cost: "))
        << summary.message;
    EXPECT_FALSE(std::isfinite(summary.initial_cost));
  }
}

// A finite residual whose square overflows.
TEST(Case52, total_cost_overflows) {
  World world;
  double* x = world.Add({1.0});
  world.problem.AddResidualBlock(
      Scalar([](double v) { return 1e200 + v; }, [](double) { return 1.0; }), nullptr, x);
  ExpectEndAtNoNumber(Solve(Small(), &world.problem).summary);
  EXPECT_EQ(x[0], 1.0);
}

// So large a column is scaled to zero, and no step is valid.
TEST(Case52, a_column_whose_square_overflows) {
  if (kRelease >= 202) {
    GTEST_SKIP()
        << "from Ceres 2.2 on a start of infinite cost ends the solve before its first step";
  }
  World world;
  double* x = world.Add({1.0});
  world.problem.AddResidualBlock(Target({0.0}, 1e200), nullptr, x);
  const Summary summary = Solve(Small(), &world.problem).summary;
  EXPECT_EQ(summary.termination_type, ceres::FAILURE);
  EXPECT_TRUE(StartsWith(summary.message, "Number of consecutive invalid steps more than "))
      << summary.message;
  EXPECT_EQ(summary.iterations.size(), 5u);
  EXPECT_EQ(x[0], 1.0);
}

// A loss whose output is NaN.
class NaNLoss : public ceres::LossFunction {
 public:
  void Evaluate(double, double rho[3]) const override {
    rho[0] = std::numeric_limits<double>::quiet_NaN();
    rho[1] = 1.0;
    rho[2] = 0.0;
  }
};

TEST(Case52, total_cost_is_nan) {
  World world;
  double* x = world.Add({1.0});
  world.problem.AddResidualBlock(Target({0.0}), new NaNLoss, x);
  ExpectEndAtNoNumber(Solve(Small(), &world.problem).summary);
  EXPECT_EQ(x[0], 1.0);
}

// The test of the gradient is negated: what is no number is below the tolerance.
void ExpectEndAtNoGradient(const Summary& summary) {
  EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE);
  EXPECT_EQ(summary.message, "Gradient tolerance reached. Gradient max norm: nan <= 1.000000e-10");
  ASSERT_EQ(summary.iterations.size(), 1u);
  EXPECT_TRUE(std::isnan(summary.iterations[0].gradient_max_norm));
}

// A loss of this slope.
class Slope : public ceres::LossFunction {
 public:
  explicit Slope(double slope) : slope_(slope) {}
  void Evaluate(double s, double rho[3]) const override {
    rho[0] = s;
    rho[1] = slope_;
    rho[2] = 0.0;
  }

 private:
  const double slope_;
};

// √ρ' is no number.
TEST(Case52, gradient_is_nan) {
  for (const double slope : {-1.0, std::numeric_limits<double>::quiet_NaN()}) {
    for (const bool schur : {false, true}) {
      World world;
      double* x = world.Add({1.0, 2.0});
      world.problem.AddResidualBlock(Target({0.0, 0.0}), new Slope(slope), x);
      ExpectEndAtNoGradient(Solve(schur ? Schur() : Small(), &world.problem).summary);
      EXPECT_EQ(world.blocks[0], (std::vector<double>{1.0, 2.0}));
    }
  }
}

// Pulls whose sum is ∞ − ∞.
TEST(Case52, gradient_of_infinities) {
  if (kRelease >= 202) {
    GTEST_SKIP() << "from Ceres 2.2 on a start of infinite cost cannot be evaluated";
  }
  World world;
  double* x = world.Add({0.0});
  for (const double target : {1.0, -1.0}) {
    world.problem.AddResidualBlock(Target({target}, 1e160), nullptr, x);
  }
  ExpectEndAtNoGradient(Solve(Small(), &world.problem).summary);
  EXPECT_EQ(x[0], 0.0);
}

TEST(Case52, max_iterations_or_time) {
  for (const bool time : {false, true}) {
    Rosenbrock rosenbrock;
    Options options = Small();
    options.max_num_iterations = time ? 50 : 4;
    options.max_solver_time_in_seconds = time ? 0.2 : 1e9;
    Callback callback([&](const ceres::IterationSummary& iteration) {
      std::this_thread::sleep_for(
          std::chrono::milliseconds(time && iteration.iteration == 4 ? 250 : 0));
      return ceres::SOLVER_CONTINUE;
    });
    options.callbacks.push_back(&callback);
    const Summary summary = Solve(options, &rosenbrock.problem).summary;
    EXPECT_EQ(summary.termination_type, ceres::NO_CONVERGENCE);
    EXPECT_EQ(summary.iterations.size(), 5u);
    const double* x = rosenbrock.x;
    ExpectClose(0.5 * (std::pow(1.0 - x[0], 2) + 100.0 * std::pow(x[1] - x[0] * x[0], 2)),
                summary.final_cost);
  }
}

TEST(Case52, bounds_and_a_failure) {
  Line line;
  line.problem.SetParameterLowerBound(line.x, 0, 2.0);
  Callback abort([](const ceres::IterationSummary&) { return ceres::SOLVER_ABORT; });
  Options options = Small();
  options.update_state_every_iteration = true;
  options.callbacks.push_back(&abort);
  EXPECT_EQ(Solve(options, &line.problem).summary.termination_type, ceres::USER_FAILURE);
  EXPECT_EQ(line.x[0], 0.5) << "the original, infeasible value";
}

TEST(Case52, nonmonotonic) {
  Rosenbrock rosenbrock;
  Options options = Small();
  options.use_nonmonotonic_steps = true;
  double lowest = std::numeric_limits<double>::max();
  double last = 0.0;
  // Stop right after a step that went up: the minimum is returned, not the last iterate.
  Callback callback([&](const ceres::IterationSummary& iteration) {
    lowest = iteration.step_is_successful ? std::min(lowest, iteration.cost) : lowest;
    last = iteration.cost;
    return iteration.step_is_nonmonotonic ? ceres::SOLVER_TERMINATE_SUCCESSFULLY
                                          : ceres::SOLVER_CONTINUE;
  });
  options.callbacks.push_back(&callback);
  const Summary summary = Solve(options, &rosenbrock.problem).summary;
  EXPECT_EQ(summary.termination_type, ceres::USER_SUCCESS);
  EXPECT_GT(last, lowest);
  const double* x = rosenbrock.x;
  ExpectClose(0.5 * (std::pow(1.0 - x[0], 2) + 100.0 * std::pow(x[1] - x[0] * x[0], 2)), lowest);
}

// Only blocks of the reduced program are ever written, and once, at the end.
TEST(Case52, what_is_written) {
  Line line;
  double* c = line.Add({1.0, -0.0});
  double* unused = line.Add({2.0, -0.0});
  line.problem.AddResidualBlock(Target({2.0, 2.0}), nullptr, c);
  line.problem.SetParameterBlockConstant(c);
  line.problem.AddParameterBlock(unused, 2);
  Solve(Small(), &line.problem);
  EXPECT_TRUE(std::signbit(c[1]) && std::signbit(unused[1]));
  EXPECT_EQ(c[0], 1.0);
  EXPECT_EQ(unused[0], 2.0);
}

}  // namespace
}  // namespace conformance
