// Blocks of Jacobians that are all zeros, left out of H: the same steps, whatever moves between
// linearizations.
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/problem/losses.h"
#include "inceres/solver/solver.h"
#include "support/random_graph.h"
#include "trust_region/curve.h"
#include "trust_region/solver_way.h"

namespace inceres {
namespace {

using test::kControlPoints;
using test::MakeCurve;

// Of each observation, the first control point that counts.
std::vector<int> Segments(const FactorGraph& graph) {
  std::vector<int> segments;
  for (VariableId id = kControlPoints; id < graph.num_variables(); ++id) {
    segments.push_back(static_cast<int>(std::floor(graph.Values(id)[0])));
  }
  return segments;
}

SolverOptions Dynamic() {
  SolverOptions options;
  options.dynamic_sparsity = true;
  options.max_num_iterations = 15;
  options.function_tolerance = 1e-10;
  return options;
}

SolverOptions Static() {
  SolverOptions options = Dynamic();
  options.dynamic_sparsity = false;
  return options;
}

void ExpectSameTrace(const Summary& a, const Summary& b, double tolerance) {
  EXPECT_EQ(a.termination, b.termination);
  ASSERT_EQ(a.iterations.size(), b.iterations.size());
  for (std::size_t k = 0; k < a.iterations.size(); ++k) {
    EXPECT_EQ(a.iterations[k].step_is_successful, b.iterations[k].step_is_successful) << k;
    EXPECT_NEAR(a.iterations[k].cost, b.iterations[k].cost, tolerance * b.iterations[k].cost) << k;
    EXPECT_NEAR(a.iterations[k].gradient_norm, b.iterations[k].gradient_norm,
                tolerance * b.iterations[0].gradient_norm)
        << k;
  }
}

TEST(DynamicSparsity, TraceIsThatOfTheWholeJacobian) {
  for (const unsigned seed : {1U, 2U, 3U}) {
    for (const auto strategy :
         {TrustRegionStrategyKind::kLevenbergMarquardt, TrustRegionStrategyKind::kDogleg}) {
      SolverOptions dynamic = Dynamic();
      SolverOptions whole = Static();
      dynamic.strategy = whole.strategy = strategy;
      // points that move from segment to segment make rounding errors grow with the steps: to 5e-8
      dynamic.max_num_iterations = whole.max_num_iterations = 8;
      FactorGraph a = MakeCurve(seed);
      FactorGraph b = MakeCurve(seed);
      const std::vector<int> before = Segments(a);
      const Summary summary = Solve(dynamic, &a);
      ASSERT_TRUE(summary.IsSolutionUsable()) << summary.message;
      ExpectSameTrace(summary, Solve(whole, &b), 1e-7);
      EXPECT_LT(summary.final_cost, 0.1 * summary.initial_cost);
      EXPECT_NE(Segments(a), before) << "no zeros have moved";
      EXPECT_EQ(summary.reduced_solver.substr(0, 15), "sparse Cholesky");
    }
  }
}

TEST(DynamicSparsity, SoItIsWithLossesAndConstants) {
  for (const unsigned seed : {4U, 5U}) {
    const auto loss = std::make_shared<CauchyLoss>(0.3);
    FactorGraph a = MakeCurve(seed, loss, /*some_constant=*/true);
    FactorGraph b = MakeCurve(seed, loss, /*some_constant=*/true);
    const std::vector<int> before = Segments(a);
    SolverOptions dynamic = Dynamic();
    SolverOptions whole = Static();
    // a redescending loss makes rounding errors grow from step to step
    dynamic.max_num_iterations = whole.max_num_iterations = 8;
    ExpectSameTrace(Solve(dynamic, &a), Solve(whole, &b), 1e-7);
    EXPECT_NE(Segments(a), before);
  }
}

TEST(DynamicSparsity, LandmarksAreFrames) {
  const auto ours = test::MakeBundle(test::MixedBundle(60));
  const auto plain = test::MakeBundle(test::MixedBundle(60));
  SolverOptions options;
  options.max_num_iterations = 6;
  options.linear_model = LinearModelKind::kPlain;
  const Summary expected = Solve(options, &plain->graph());
  options.linear_model = LinearModelKind::kAutomatic;
  options.dynamic_sparsity = true;
  const Summary summary = Solve(options, &ours->graph());
  ExpectSameTrace(summary, expected, 1e-8);
  EXPECT_EQ(summary.work.num_landmarks, 0);
}

TEST(DynamicSparsity, NamesTheModelsItDoesNotGoWith) {
  for (const auto model : {LinearModelKind::kSchur, LinearModelKind::kDenseQr}) {
    SolverOptions options = Dynamic();
    options.linear_model = model;
    EXPECT_EQ(options.Validate().code, StatusCode::kInvalidArgument);
    EXPECT_NE(options.Validate().message.find("SolverOptions::dynamic_sparsity"),
              std::string::npos);
  }
}

}  // namespace
}  // namespace inceres
