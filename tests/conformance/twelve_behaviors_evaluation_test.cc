// docs/ceres_contract.md, "Twelve behaviors of estimators", 5 to 7: how cost functions are called.
#include <cmath>
#include <mutex>

#include "conformance/support.h"

namespace conformance {
namespace {

bool Exact() {
  return ThisRun() != Way::kIncremental;
}

// Normal equations, which incremental mode can do too.
Options Normal() {
  Options options;
  options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
  return options;
}

// OKVIS's IMU error: integrates anew inside Evaluate once the bias has moved far enough, and
// extrapolates from there till then. r = (x − sin(b) as of the last integration, b − 1).
struct Imu {
  double at = 0.0;  // the bias of the last integration
  int num_integrations = 0;
  int num_calls = 0;
  std::mutex mutex;

  Cost* MakeCost() {
    return new Cost(2, {1, 1},
                    [this](double const* const* p, double* residuals, double** jacobians) {
                      const std::lock_guard<std::mutex> lock(mutex);
                      ++num_calls;
                      if (std::abs(p[1][0] - at) > 0.3) {
                        at = p[1][0];
                        ++num_integrations;
                      }
                      residuals[0] = p[0][0] - std::sin(at) - std::cos(at) * (p[1][0] - at);
                      residuals[1] = p[1][0] - 1.0;
                      if (jacobians != nullptr) {
                        jacobians[0][0] = 1.0;
                        jacobians[0][1] = 0.0;
                        jacobians[1][0] = -std::cos(at);
                        jacobians[1][1] = 1.0;
                      }
                      return true;
                    });
  }
};

TEST(TwelveBehaviors, b05_evaluate_has_memory) {
  for (const int num_threads : {1, 2}) {
    World world;
    Imu imu;
    double* x = world.Add({3.0});
    double* b = world.Add({0.0});
    world.problem.AddResidualBlock(imu.MakeCost(), nullptr, x, b);
    world.problem.AddResidualBlock(Target({2.0}), nullptr, x);
    world.problem.AddResidualBlock(Target({-0.5}), nullptr, b);
    Options options = Normal();
    options.num_threads = num_threads;
    const Summary summary = Solve(options, &world.problem).summary;
    EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE);
    EXPECT_GT(imu.num_integrations, 0);
    if (Exact()) {  // number and order of the calls are part of the result
      EXPECT_EQ(imu.num_calls, summary.num_residual_evaluations + summary.num_jacobian_evaluations);
      EXPECT_EQ(imu.num_calls, 6);
      EXPECT_EQ(imu.num_integrations, 1);
      EXPECT_NEAR(imu.at, 0.59999599376, 1e-9);
    }
    EXPECT_NEAR(x[0], 1.26333965628, Exact() ? 1e-9 : 1e-2);
    EXPECT_NEAR(b[0], 0.55399991067, Exact() ? 1e-9 : 1e-2);
  }
}

// XRSLAM's preintegration factor: corrects by the difference of its argument to the bias in the
// frame, which Ceres writes at the end of an iteration. One line of events: J and c for calls with
// and without Jacobians, k for the callback, each with the memory.
struct Frame {
  double bias = 0.5;
  double scale = 1.0;
};

TEST(TwelveBehaviors, b06_evaluate_reads_user_memory) {
  Frame frame;
  std::vector<std::pair<char, double>> events;
  ceres::Problem problem;
  auto* factor =
      new Cost(1, {1}, [&](double const* const* p, double* residuals, double** jacobians) {
        events.emplace_back(jacobians == nullptr ? 'c' : 'J', frame.bias);
        EXPECT_NE(p[0], &frame.bias) << "an internal copy is handed in";
        residuals[0] = std::exp(0.5 * p[0][0]) - 2.0 + 0.1 * (p[0][0] - frame.bias);
        if (jacobians != nullptr && jacobians[0] != nullptr) {
          jacobians[0][0] = 0.5 * std::exp(0.5 * p[0][0]) + 0.1;
        }
        return true;
      });
  problem.AddResidualBlock(factor, nullptr, &frame.bias);
  std::vector<double> states;
  Callback callback([&](const ceres::IterationSummary&) {
    events.emplace_back('k', frame.bias);
    states.push_back(frame.bias);
    return ceres::SOLVER_CONTINUE;
  });
  Options options = Normal();
  options.update_state_every_iteration = true;
  options.callbacks.push_back(&callback);
  const Summary summary = Solve(options, &problem).summary;
  EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE);
  EXPECT_NEAR(frame.bias, 2.0 * std::log(2.0), 1e-3);
  if (!Exact()) {
    return;
  }
  ASSERT_GE(states.size(), 3u);
  // Iteration 0: Jacobians, write, callback. Then: candidate with what the last iteration wrote;
  // Jacobians at the accepted point before the write; callback after it.
  std::vector<std::pair<char, double>> expected = {{'J', 0.5}, {'k', 0.5}};
  for (std::size_t i = 1; i < states.size(); ++i) {
    ASSERT_TRUE(summary.iterations[i].step_is_successful);
    expected.insert(expected.end(), {{'c', states[i - 1]}, {'J', states[i - 1]}, {'k', states[i]}});
  }
  if (events.size() > expected.size()) {
    expected.emplace_back('c', states.back());  // the candidate that ended it
  }
  EXPECT_EQ(events, expected);
  EXPECT_NEAR(states[1], 1.46481230707, 1e-9);
  EXPECT_NEAR(states[2], 1.3099449692, 1e-9);
}

// OKVIS2's two-pose error: without Jacobians it gives zero. Accepted on the truncated cost,
// returned is the lowest full cost.
TEST(TwelveBehaviors, b07_cost_only_against_jacobian_calls) {
  Line line;
  auto* hack = new Cost(1, {1}, [](double const* const* p, double* residuals, double** jacobians) {
    residuals[0] = jacobians == nullptr ? 0.0 : 2.0 * p[0][0];
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      // the step does not know of it: it leads to 10, where the full cost is 200
      jacobians[0][0] = 0.0;
    }
    return true;
  });
  line.problem.AddResidualBlock(hack, nullptr, line.x);
  const Summary summary = Solve(Normal(), &line.problem).summary;
  EXPECT_TRUE(summary.IsSolutionUsable());
  EXPECT_EQ(summary.initial_cost, 45.625);
  EXPECT_LE(summary.final_cost, 45.625) << "never above the start";
  if (Exact()) {
    ASSERT_GE(summary.iterations.size(), 2u);
    EXPECT_TRUE(summary.iterations[1].step_is_successful) << "by its truncated cost";
    ExpectClose(summary.iterations[1].cost_change, 45.625, 1e-6);
    ExpectClose(summary.iterations[1].cost, 200.0, 1e-3);
    EXPECT_EQ(summary.final_cost, 45.625);
    EXPECT_EQ(line.x[0], 0.5) << "the iterate of the lowest full cost";
  }
}

// … and returns false while its numbers are not there yet.
TEST(TwelveBehaviors, b07_an_error_that_is_not_computed_yet) {
  Line line;
  bool computed = false;
  auto* error =
      new Cost(1, {1}, [&](double const* const* p, double* residuals, double** jacobians) {
        residuals[0] = p[0][0] - 4.0;
        if (jacobians != nullptr && jacobians[0] != nullptr) {
          jacobians[0][0] = 1.0;
        }
        return computed;
      });
  line.problem.AddResidualBlock(error, nullptr, line.x);
  EXPECT_EQ(Solve(Normal(), &line.problem).summary.termination_type, ceres::FAILURE);
  EXPECT_EQ(line.x[0], 0.5);
  computed = true;
  EXPECT_EQ(Solve(Normal(), &line.problem).summary.termination_type, ceres::CONVERGENCE);
  EXPECT_NEAR(line.x[0], 7.0, 1e-3);
}

}  // namespace
}  // namespace conformance
