// docs/ceres_contract.md, "Case table", continued: cost functions and manifolds that fail. Kinds of
// failing evaluations are next to stock in adapters/evaluation_test.cc.
#include <cmath>
#include <limits>
#include <numeric>
#include <vector>

#include "conformance/support.h"
#include "support/ceres_manifolds.h"

namespace conformance {
namespace {

const std::vector<double> kStart = {5.0, 7.0};

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
