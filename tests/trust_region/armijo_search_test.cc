#include <cmath>

#include <gtest/gtest.h>

#include "trust_region/bounded_line_search.h"

namespace inceres::internal {
namespace {

// Searches along φ and writes down where it looked.
struct Trace {
  std::optional<double> t;
  std::vector<double> visited;
  LineSearchSummary summary;
};

Trace Search(const SolverOptions& options, double slope, const std::function<double(double)>& phi,
             const std::function<double(double)>& phi_slope, double step_max_norm = 1.0) {
  Trace trace;
  LineFunction function;
  function.value = phi(0.0);
  function.slope = slope;
  function.step_max_norm = step_max_norm;
  function.sample = [&](double t) {
    trace.visited.push_back(t);
    const double value = phi(t);
    return FunctionSample{t, value, phi_slope(t), std::isfinite(value), std::isfinite(value)};
  };
  trace.t = SearchArmijo(options, function, &trace.summary);
  return trace;
}

SolverOptions With(LineSearchInterpolation interpolation) {
  SolverOptions options;
  options.line_search_interpolation = interpolation;
  return options;
}

double Quadratic(double t) {
  return 1.0 - t + 5.0 * t * t;
}  // lowest at 0.1, Armijo holds below about 0.2
double QuadraticSlope(double t) {
  return -1.0 + 10.0 * t;
}

TEST(Armijo, TakesTheFullStepIfItWill) {
  const Trace trace = Search(
      SolverOptions(), -1.0, [](double t) { return 1.0 - t; }, [](double) { return -1.0; });
  EXPECT_EQ(trace.t, 1.0);
  EXPECT_EQ(trace.visited, std::vector<double>{1.0});
  EXPECT_EQ(trace.summary.num_steps, 0);
}

TEST(Armijo, Bisects) {
  const Trace trace =
      Search(With(LineSearchInterpolation::kBisection), -1.0, Quadratic, QuadraticSlope);
  EXPECT_EQ(trace.visited, (std::vector<double>{1.0, 0.5, 0.25, 0.125}));
  EXPECT_EQ(trace.t, 0.125);
  EXPECT_EQ(trace.summary.num_steps, 3);
}

TEST(Armijo, APolynomialFindsTheMinimumAtOnce) {
  for (const auto interpolation :
       {LineSearchInterpolation::kQuadratic, LineSearchInterpolation::kCubic}) {
    const Trace trace = Search(With(interpolation), -1.0, Quadratic, QuadraticSlope);
    ASSERT_EQ(trace.visited.size(), 2U);
    EXPECT_NEAR(*trace.t, 0.1, 1e-12);
  }
}

TEST(Armijo, ContractionStaysWithinItsLimits) {
  SolverOptions options = With(LineSearchInterpolation::kQuadratic);
  options.max_line_search_step_contraction = 0.4;
  EXPECT_EQ(Search(options, -1.0, Quadratic, QuadraticSlope).visited[1], 0.4);
  options = With(LineSearchInterpolation::kBisection);
  options.min_line_search_step_contraction = 0.3;
  EXPECT_EQ(Search(options, -1.0, Quadratic, QuadraticSlope).visited[1], 0.3);
}

TEST(Armijo, WhatCannotBeEvaluatedIsHalvedAndForgotten) {
  const auto phi = [](double t) { return t > 0.3 ? std::nan("") : Quadratic(t); };
  const Trace trace = Search(With(LineSearchInterpolation::kCubic), -1.0, phi, QuadraticSlope);
  ASSERT_EQ(trace.visited.size(), 4U);
  EXPECT_EQ(trace.visited[1], 0.5);
  EXPECT_EQ(trace.visited[2], 0.25);
  EXPECT_NEAR(*trace.t, 0.1, 1e-12);
}

TEST(Armijo, GivesUpAtItsLimits) {
  const auto uphill = [](double t) { return 1.0 + t; };
  SolverOptions options = With(LineSearchInterpolation::kBisection);
  options.max_num_line_search_step_size_iterations = 3;
  Trace trace = Search(options, -1.0, uphill, [](double) { return 1.0; });
  EXPECT_FALSE(trace.t.has_value());
  EXPECT_EQ(trace.visited.size(), 3U);
  EXPECT_EQ(trace.summary.num_steps, 3);
  options = With(LineSearchInterpolation::kBisection);
  options.min_line_search_step_size = 0.2;
  trace = Search(
      options, -1.0, uphill, [](double) { return 1.0; }, /*step_max_norm=*/1.0);
  EXPECT_FALSE(trace.t.has_value());
  EXPECT_EQ(trace.visited.back(), 0.25) << "0.125 is too small";
}

TEST(Armijo, SufficientDecreaseIsALine) {
  SolverOptions options;
  options.line_search_sufficient_function_decrease = 0.5;
  const auto line = [](double share) { return [share](double t) { return 1.0 - share * t; }; };
  const auto slope = [](double) { return -1.0; };
  EXPECT_EQ(Search(options, -1.0, line(0.5), slope).visited.size(), 1U) << "on the line is enough";
  EXPECT_GT(Search(options, -1.0, line(0.49), slope).visited.size(), 1U);
}

}  // namespace
}  // namespace inceres::internal
