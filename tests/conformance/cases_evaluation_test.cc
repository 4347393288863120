// docs/ceres_contract.md, "Case table", continued: cost functions and manifolds that fail.
#include <cmath>
#include <limits>
#include <numeric>
#include <vector>

#include "conformance/support.h"
#include "support/ceres_manifolds.h"

namespace conformance {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

// r = x₁ from (5, 7) with another term whose behavior is given: kinds of failing evaluations.
Cost* Faulty(std::function<bool(const double* x, bool with_jacobians)> fails, int kind) {
  return new Cost(2, {2}, [=](double const* const* p, double* residuals, double** jacobians) {
    const bool failed = fails(p[0], jacobians != nullptr);
    residuals[0] = failed && kind == 1 ? kNaN : failed && kind == 2 ? kInfinity : p[0][0];
    if (!(failed && kind == 3)) {
      residuals[1] = p[0][1];
    }
    if (jacobians != nullptr) {
      const double identity[4] = {1.0, 0.0, 0.0, 1.0};
      std::copy(identity, identity + (failed && kind == 4 ? 3 : 4), jacobians[0]);
    }
    return !(failed && kind == 0);
  });
}

struct FaultyWorld : World {
  FaultyWorld(const std::function<bool(const double*, bool)>& fails, int kind) {
    problem.AddResidualBlock(Faulty(fails, kind), nullptr, Add({5.0, 7.0}));
  }
};
const std::vector<double> kStart = {5.0, 7.0};

// 0: false, 1: NaN, 2: infinite, 3: residual not written, 4: Jacobian not written.
TEST(Case52, cost_function_fails_at_iteration_0) {
  for (const int kind : {0, 1, 2, 3, 4}) {
    FaultyWorld world([](const double*, bool) { return true; }, kind);
    const Outcome outcome = Solve(Small(), &world.problem);
    EXPECT_EQ(outcome.summary.termination_type, ceres::FAILURE) << "kind " << kind;
    EXPECT_EQ(outcome.summary.message, kStartFailed);
    EXPECT_EQ(outcome.errors,
              std::vector<std::string>{std::string("Terminating: ") + kStartFailed});
    EXPECT_TRUE(kind == 0 || outcome.warnings.size() == 1u)
        << "what is wrong with the residual block";
    EXPECT_TRUE(outcome.summary.iterations.empty());
    EXPECT_EQ(outcome.summary.num_successful_steps, 0);
    EXPECT_EQ(outcome.summary.num_unsuccessful_steps, 0);
    EXPECT_EQ(outcome.summary.initial_cost, -1.0);
    EXPECT_EQ(world.blocks[0], kStart);
  }
}

// The first candidate, about (0, 0), fails; the next ones are shorter.
TEST(Case52, cost_function_fails_at_a_trial_point) {
  for (const int kind : {0, 1, 2, 3}) {
    FaultyWorld world([](const double* x, bool) { return std::abs(x[0]) < 1.0; }, kind);
    Options options = Small();
    options.max_num_iterations = 30;
    const Summary summary = Solve(options, &world.problem).summary;
    EXPECT_TRUE(summary.IsSolutionUsable());
    ASSERT_GT(summary.iterations.size(), 2u);
    EXPECT_EQ(summary.iterations[1].cost, std::numeric_limits<double>::max());
    EXPECT_TRUE(summary.iterations[1].step_is_valid);
    EXPECT_FALSE(summary.iterations[1].step_is_successful);
    EXPECT_LT(world.blocks[0][0], 5.0) << "the best accepted iterate";
    EXPECT_GE(world.blocks[0][0], 1.0);
  }
}

TEST(Case52, cost_function_fails_at_the_jacobian_of_an_accepted_point) {
  for (const int kind : {0, 1, 2, 3, 4}) {
    FaultyWorld world(
        [](const double* x, bool with_jacobians) { return with_jacobians && x[0] < 1e-6; }, kind);
    Options options = Small();
    options.update_state_every_iteration = true;
    const Summary summary = Solve(options, &world.problem).summary;
    EXPECT_EQ(summary.termination_type, ceres::FAILURE);
    EXPECT_EQ(summary.message, "Residual and Jacobian evaluation failed.");
    EXPECT_EQ(summary.iterations.size(), 2u);
    EXPECT_EQ(world.blocks[0], kStart) << "all progress is discarded";
  }
}

// R² whose Plus leads, or whose PlusJacobian is asked for, to where |x₀| is too small.
class Limited : public manifolds::Manifold {
 public:
  Limited(const double* plus_limit, const double* jacobian_limit)
      : plus_limit_(plus_limit), jacobian_limit_(jacobian_limit) {}
  int AmbientSize() const override { return 2; }
  int TangentSize() const override { return 2; }
  bool Plus(const double* x, const double* delta, double* sum) const override {
    sum[0] = x[0] + delta[0];
    sum[1] = x[1] + delta[1];
    return std::abs(sum[0]) >= *plus_limit_;
  }
  bool PlusJacobian(const double* x, double* jacobian) const override {
    const double identity[4] = {1.0, 0.0, 0.0, 1.0};
    std::copy(identity, identity + 4, jacobian);
    return std::abs(x[0]) >= *jacobian_limit_;
  }
  bool Minus(const double*, const double*, double*) const override { return false; }
  bool MinusJacobian(const double*, double*) const override { return false; }

 private:
  const double* plus_limit_;
  const double* jacobian_limit_;
};

// From (5, 7) the gradient leads to 0.96 x and the first step to 1e-4 x; the sixth is the first
// that is short enough.
void ExpectShorterSteps(const Limited& manifold, World* world) {
  double* x = world->Add(kStart);
  world->problem.AddResidualBlock(Target({0.0, 0.0}, 0.2), nullptr, x);
  manifolds::Set(&world->problem, x, new Limited(manifold));
  Options options = Small();
  options.max_num_iterations = 6;
  const Summary summary = Solve(options, &world->problem).summary;
  EXPECT_TRUE(summary.IsSolutionUsable()) << summary.message;
  ASSERT_EQ(summary.iterations.size(), 7u);
  EXPECT_EQ(summary.iterations[1].cost, std::numeric_limits<double>::max());
  EXPECT_FALSE(summary.iterations[1].step_is_successful);
  EXPECT_TRUE(summary.iterations[6].step_is_successful);
  EXPECT_GE(x[0], 1.0);
  EXPECT_LT(x[0], 5.0);
}

TEST(Case52, plus_false_at_a_trial_point) {
  const double limit = 1.0;
  const double never = 0.0;
  World world;
  ExpectShorterSteps(Limited(&limit, &never), &world);
}

TEST(Case52, plus_jacobian_false_at_a_trial_point) {
  const double limit = 1.0;
  const double never = 0.0;
  World world;
  ExpectShorterSteps(Limited(&never, &limit), &world);
}

TEST(Case52, plus_jacobian_false_at_iteration_0) {
  World world;
  double* x = world.Add(kStart);
  double limit = 0.0;
  const double never = 0.0;
  world.problem.AddResidualBlock(Target({0.0, 0.0}), nullptr, x);
  manifolds::Set(&world.problem, x, new Limited(&never, &limit));
  limit = 100.0;
  const Summary summary = Solve(Small(), &world.problem).summary;
  EXPECT_EQ(summary.termination_type, ceres::FAILURE);
  EXPECT_EQ(summary.message, kStartFailed);
  EXPECT_EQ(world.blocks[0], kStart);
}

TEST(Case52, nothing_is_called_after_a_cost_function_that_failed) {
  World world;
  std::vector<int> num_calls(1000, 0);
  double* x = world.Add({1.0});
  for (int& calls : num_calls) {
    const bool fails = &calls == &num_calls[0];
    world.problem.AddResidualBlock(
        new Cost(1, {1},
                 [&calls, fails](double const* const* p, double* residuals, double** jacobians) {
                   ++calls;
                   residuals[0] = p[0][0];
                   if (jacobians != nullptr && jacobians[0] != nullptr) {
                     jacobians[0][0] = 1.0;
                   }
                   return !fails;
                 }),
        nullptr, x);
  }
  EXPECT_EQ(Solve(Small(), &world.problem).summary.termination_type, ceres::FAILURE);
  EXPECT_EQ(std::accumulate(num_calls.begin(), num_calls.end(), 0), 1);
}

}  // namespace
}  // namespace conformance
