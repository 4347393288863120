#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "conformance/support.h"

/// Solves whose every step the tests of IterationSummary know: accepted and rejected ones, invalid
/// ones, one that cannot be evaluated.
namespace conformance {

inline constexpr double kFixedCost = 2.0;

/// Rosenbrock's problem beside a fixed cost of 2, with the points of evaluation: each candidate's,
/// and each linearization's.
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

  /// ½‖r‖² at a point, and ‖x − (x − g)‖ = ‖g‖.
  static double CostAt(const std::vector<double>& x) {
    return 0.5 * (std::pow(1.0 - x[0], 2) + 100.0 * std::pow(x[1] - x[0] * x[0], 2));
  }
  static std::vector<double> GradientAt(const std::vector<double>& x) {
    const double r1 = 10.0 * (x[1] - x[0] * x[0]);
    return {-(1.0 - x[0]) - 20.0 * x[0] * r1, 10.0 * r1};
  }
  /// Calls f(iteration i ≥ 1, its start x, its candidate) for every iteration of the trace.
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

/// Three invalid steps: iterations 1 to 3.
inline Summary Invalid() {
  NeverValid world;
  Options options = Small();
  options.eta = 0.25;
  options.gradient_tolerance = 0.0;
  options.max_num_iterations = 3;
  const Summary summary = Solve(options, &world.problem).summary;
  EXPECT_EQ(summary.iterations.size(), 4u);
  return summary;
}

/// One step that cannot be evaluated.
inline ceres::IterationSummary NotEvaluable() {
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

}  // namespace conformance
