// docs/ceres_contract.md, "IterationSummary fields": at iteration 0 and after accepted, rejected
// and invalid steps.
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "conformance/support.h"
#include "support/ceres_manifolds.h"

namespace conformance {
namespace {

// Solves whose every step is known: accepted and rejected ones, invalid ones, one that cannot be
// evaluated.

constexpr double kFixedCost = 2.0;

// Rosenbrock's problem beside a fixed cost of 2, with the points of evaluation: each candidate's,
// and each linearization's.
struct Trace : World {
  explicit Trace(bool nonmonotonic = false) {
    double* x = Add({-1.2, 1.0});
    double* c = Add({1.0});
    auto* cost =
        new Cost(2, {2}, [this](double const* const* p, double* residuals, double** jacobians) {
          const double a = p[0][0];
          const double b = p[0][1];
          (jacobians == nullptr ? candidates : linearized).push_back({a, b});
          residuals[0] = 1.0 - a;
          residuals[1] = 10.0 * (b - a * a);
          if (jacobians != nullptr) {
            const double jacobian[4] = {-1.0, 0.0, -20.0 * a, 10.0};
            std::copy(jacobian, jacobian + 4, jacobians[0]);
          }
          return true;
        });
    problem.AddResidualBlock(cost, nullptr, x);
    problem.AddResidualBlock(Target({3.0}), nullptr, c);
    problem.SetParameterBlockConstant(c);
    Options options = Small();
    options.eta = 0.25;
    options.use_nonmonotonic_steps = nonmonotonic;
    summary = Solve(options, &problem).summary;
  }

  // ½‖r‖² at a point, and ‖x − (x − g)‖ = ‖g‖.
  static double CostAt(const std::vector<double>& x) {
    return 0.5 * (std::pow(1.0 - x[0], 2) + 100.0 * std::pow(x[1] - x[0] * x[0], 2));
  }
  static std::vector<double> GradientAt(const std::vector<double>& x) {
    const double r1 = 10.0 * (x[1] - x[0] * x[0]);
    return {-(1.0 - x[0]) - 20.0 * x[0] * r1, 10.0 * r1};
  }
  // Calls f(iteration i ≥ 1, its start x, its candidate) for every iteration of the trace.
  template <typename Function>
  void ForEachStep(Function f) const {
    std::size_t at = 0;
    ASSERT_EQ(candidates.size(), summary.iterations.size())
        << "the last one ended it by a tolerance";
    for (std::size_t i = 1; i < summary.iterations.size(); ++i) {
      f(i, linearized[at], candidates[i - 1]);
      at += summary.iterations[i].step_is_successful ? 1 : 0;
    }
  }
  const ceres::IterationSummary& operator[](std::size_t i) const { return summary.iterations[i]; }

  std::vector<std::vector<double>> candidates;
  std::vector<std::vector<double>> linearized;
  Summary summary;
};

// Three invalid steps: iterations 1 to 3.
Summary Invalid() {
  NeverValid world;
  Options options = Small();
  options.eta = 0.25;
  options.gradient_tolerance = 0.0;
  options.max_num_iterations = 3;
  const Summary summary = Solve(options, &world.problem).summary;
  EXPECT_EQ(summary.iterations.size(), 4u);
  return summary;
}

// One step that cannot be evaluated.
ceres::IterationSummary NotEvaluable() {
  World world;
  double* x = world.Add({0.5});
  auto* cost = new Cost(1, {1}, [](double const* const* p, double* residuals, double** jacobians) {
    residuals[0] = p[0][0] == 0.5 ? 9.5 : std::numeric_limits<double>::quiet_NaN();
    if (jacobians != nullptr) {
      jacobians[0][0] = -1.0;
    }
    return true;
  });
  world.problem.AddResidualBlock(cost, nullptr, x);
  Options options = Small();
  options.max_num_iterations = 1;
  const Summary summary = Solve(options, &world.problem).summary;
  EXPECT_EQ(summary.iterations.size(), 2u);
  return summary.iterations[1];
}

TEST(Iteration32, iteration) {
  const Trace trace;
  for (std::size_t i = 0; i < trace.summary.iterations.size(); ++i) {
    EXPECT_EQ(trace[i].iteration, static_cast<int>(i));
  }
}

TEST(Iteration32, step_is_valid) {
  const Trace trace;
  EXPECT_TRUE(trace[0].step_is_valid && trace[0].step_is_successful);
  int num_rejected = 0;
  trace.ForEachStep([&](std::size_t i, const auto&, const auto&) {
    EXPECT_TRUE(trace[i].step_is_valid);
    EXPECT_EQ(trace[i].step_is_successful, trace[i].relative_decrease > 1e-3);
    num_rejected += trace[i].step_is_successful ? 0 : 1;
  });
  EXPECT_GT(num_rejected, 0);
  const ceres::IterationSummary invalid = Invalid().iterations[1];
  EXPECT_FALSE(invalid.step_is_valid || invalid.step_is_successful);
}

TEST(Iteration32, step_is_nonmonotonic) {
  const Trace trace(true);
  EXPECT_FALSE(trace[0].step_is_nonmonotonic);
  double minimum = trace[0].cost;
  int num_nonmonotonic = 0;
  for (std::size_t i = 1; i < trace.summary.iterations.size(); ++i) {
    EXPECT_EQ(trace[i].step_is_nonmonotonic,
              trace[i].step_is_successful && trace[i].cost >= minimum)
        << i;
    num_nonmonotonic += trace[i].step_is_nonmonotonic ? 1 : 0;
    minimum = trace[i].step_is_successful ? std::min(minimum, trace[i].cost) : minimum;
  }
  EXPECT_GT(num_nonmonotonic, 0);
}

TEST(Iteration32, cost) {
  const Trace trace;
  ExpectClose(trace[0].cost, 12.1 + kFixedCost, 1e-14);
  trace.ForEachStep([&](std::size_t i, const auto&, const auto& candidate) {
    ExpectClose(trace[i].cost, Trace::CostAt(candidate) + kFixedCost, 1e-14);
  });
  EXPECT_EQ(Invalid().iterations[2].cost, 0.5) << "after an invalid step the current cost";
  EXPECT_EQ(NotEvaluable().cost, std::numeric_limits<double>::max());
}

TEST(Iteration32, cost_change) {
  const Trace trace;
  EXPECT_EQ(trace[0].cost_change, 0.0);
  bool negative = false;
  trace.ForEachStep([&](std::size_t i, const auto& x, const auto& candidate) {
    EXPECT_NEAR(trace[i].cost_change, Trace::CostAt(x) - Trace::CostAt(candidate), 1e-11);
    negative = negative || trace[i].cost_change < 0.0;
  });
  EXPECT_TRUE(negative);
  EXPECT_EQ(Invalid().iterations[1].cost_change, 0.0);
}

TEST(Iteration32, gradient_max_norm) {
  const Trace trace;
  EXPECT_NEAR(trace[0].gradient_max_norm, 107.8, 1e-9);
  EXPECT_NEAR(trace[0].gradient_norm, std::hypot(107.8, 44.0), 1e-9);
  std::vector<double> at = trace.linearized[0];
  trace.ForEachStep([&](std::size_t i, const auto&, const auto& candidate) {
    at = trace[i].step_is_successful ? candidate : at;  // a rejected step keeps the previous one's
    const std::vector<double> g = Trace::GradientAt(at);
    EXPECT_NEAR(trace[i].gradient_max_norm, std::max(std::abs(g[0]), std::abs(g[1])), 1e-11) << i;
    EXPECT_NEAR(trace[i].gradient_norm, std::hypot(g[0], g[1]), 1e-11) << i;
  });
  EXPECT_EQ(Invalid().iterations[1].gradient_max_norm, 1e-200);
}

// In the ambient space: on the sphere of radius 5 from (0, 3, 4), at atan(4/3), by an angle of ½ ·
// ½ · 5 · 3/5 = 0.75 upward; from Ceres 2.2 on its manifold has no halves.
TEST(Iteration32, gradient_max_norm_is_measured_in_the_ambient_space) {
  World world;
  double* x = world.Add({0.0, 3.0, 4.0});
  world.problem.AddResidualBlock(Target({0.0, 3.0, 5.0}), nullptr, x);
  manifolds::Set(&world.problem, x, new manifolds::SphereManifold<3>());
  Options options = Small();
  options.max_num_iterations = 0;
  const Summary summary = Solve(options, &world.problem).summary;
  const double turn = kRelease >= 202 ? 3.0 : 0.75;
  const double angle = std::atan2(4.0, 3.0) + turn;
  const double max_norm =
      std::max(std::abs(3.0 - 5.0 * std::cos(angle)), std::abs(4.0 - 5.0 * std::sin(angle)));
  EXPECT_NEAR(summary.iterations[0].gradient_max_norm, max_norm, 1e-9);
  EXPECT_NEAR(summary.iterations[0].gradient_norm, 10.0 * std::sin(turn / 2.0), 1e-9);
}

// From Ceres 2.2 on it stays 0 until a step has been accepted.
TEST(Iteration32, step_norm) {
  const Trace trace;
  EXPECT_EQ(trace[0].step_norm, 0.0);
  bool known = kRelease < 202;
  trace.ForEachStep([&](std::size_t i, const auto& x, const auto& candidate) {
    EXPECT_NEAR(trace[i].step_norm,
                known ? std::hypot(x[0] - candidate[0], x[1] - candidate[1]) : 0.0, 1e-14);
    known = known || trace[i].step_is_successful;
  });
  EXPECT_TRUE(known);
  EXPECT_EQ(Invalid().iterations[1].step_norm, 0.0);
}

TEST(Iteration32, relative_decrease) {
  const Trace trace;
  EXPECT_EQ(trace[0].relative_decrease, 0.0);
  EXPECT_EQ(Invalid().iterations[1].relative_decrease, 0.0);
  EXPECT_EQ(NotEvaluable().relative_decrease, std::numeric_limits<double>::lowest());
  Parabola parabola;
  EXPECT_NEAR(Solve(Small(), &parabola.problem).summary.iterations[1].relative_decrease, 0.9375,
              1e-4);
}

// After the update: accepted radius/max(1/3, 1 − (2q − 1)³), rejected and invalid 1/2, then 1/4,
// 1/8, … of it.
TEST(Iteration32, trust_region_radius) {
  const Trace trace;
  EXPECT_EQ(trace[0].trust_region_radius, 1e4);
  double radius = 1e4;
  double divisor = 2.0;
  for (std::size_t i = 1; i < trace.summary.iterations.size(); ++i) {
    const double q = trace[i].relative_decrease;
    radius /= trace[i].step_is_successful ? std::max(1.0 / 3.0, 1.0 - std::pow(2.0 * q - 1.0, 3))
                                          : divisor;
    divisor = trace[i].step_is_successful ? 2.0 : 2.0 * divisor;
    ExpectClose(trace[i].trust_region_radius, radius);
  }
  const Summary invalid = Invalid();
  EXPECT_EQ(invalid.iterations[1].trust_region_radius, 5e3);
  EXPECT_EQ(invalid.iterations[2].trust_region_radius, 1.25e3);
  EXPECT_EQ(invalid.iterations[3].trust_region_radius, 156.25);
}

TEST(Iteration32, eta) {
  const Trace trace;
  EXPECT_EQ(trace[0].eta, 0.25);
  trace.ForEachStep([&](std::size_t i, const auto&, const auto&) { EXPECT_EQ(trace[i].eta, 0.0); });
  EXPECT_EQ(Invalid().iterations[1].eta, 0.25);
}

TEST(Iteration32, linear_solver_iterations) {
  const Trace trace;
  EXPECT_EQ(trace[0].linear_solver_iterations, 0);
  trace.ForEachStep([&](std::size_t i, const auto&, const auto&) {
    EXPECT_EQ(trace[i].linear_solver_iterations, 1);
  });
  Bundle bundle;  // nothing is left of the reduced system
  for (double* camera : bundle.cameras) {
    bundle.problem.SetParameterBlockConstant(camera);
  }
  EXPECT_EQ(Solve(Schur(), &bundle.problem).summary.iterations[1].linear_solver_iterations, 0);
}

TEST(Iteration32, step_size) {
  const Trace trace;
  for (const ceres::IterationSummary& iteration : trace.summary.iterations) {
    EXPECT_EQ(iteration.step_size, 0.0);
    EXPECT_EQ(iteration.line_search_function_evaluations, 0);
    EXPECT_EQ(iteration.line_search_gradient_evaluations, 0);
    EXPECT_EQ(iteration.line_search_iterations, 0);
  }
}

TEST(Iteration32, step_solver_time_in_seconds) {
  const Trace trace;
  EXPECT_EQ(trace[0].step_solver_time_in_seconds, 0.0);
  trace.ForEachStep([&](std::size_t i, const auto&, const auto&) {
    EXPECT_GE(trace[i].step_solver_time_in_seconds, 0.0);
    EXPECT_LE(trace[i].step_solver_time_in_seconds, trace[i].iteration_time_in_seconds);
  });
}

TEST(Iteration32, cumulative_time_in_seconds) {
  const Trace trace;
  EXPECT_GE(trace[0].iteration_time_in_seconds, 0.0);
  EXPECT_GE(trace[0].cumulative_time_in_seconds, trace.summary.preprocessor_time_in_seconds);
  trace.ForEachStep([&](std::size_t i, const auto&, const auto&) {
    EXPECT_GE(trace[i].iteration_time_in_seconds, 0.0);
    EXPECT_GE(trace[i].cumulative_time_in_seconds, trace[i - 1].cumulative_time_in_seconds);
  });
  const std::size_t last = trace.summary.iterations.size() - 1;
  EXPECT_LE(trace[last].cumulative_time_in_seconds, trace.summary.total_time_in_seconds);
}

}  // namespace
}  // namespace conformance
