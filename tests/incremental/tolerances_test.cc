// The tolerances of gradient and parameters, which end an Update beside that of the cost.
#include <cstddef>
#include <numeric>
#include <vector>

#include <gtest/gtest.h>

#include "incremental/incremental_bundle.h"
#include "support/dense_oracle.h"
#include "support/values_held.h"

namespace inceres::test {
namespace {

// Nothing but the tolerance under test ends an Update early.
IncrementalOptions Endless() {
  IncrementalOptions options;
  options.batch_share = 2.0;
  options.function_tolerance = 1e-15;
  return options;
}

UpdateSummary UpdateWith(const IncrementalOptions& options, double* gradient) {
  IncrementalBundle bundle(options, 21);
  bundle.Grow(8, 24, 3);
  const UpdateSummary summary = bundle.solver.Update();
  const FactorGraph graph = AtValuesHeld(bundle.solver);
  std::vector<VariableId> all(static_cast<std::size_t>(graph.num_variables()));
  std::iota(all.begin(), all.end(), 0);
  *gradient = DenseOracle(graph, all).g.cwiseAbs().maxCoeff();
  return summary;
}

TEST(Tolerances, ASmallGradientEndsAnUpdate) {
  double gradient = 0.0, at_the_end = 0.0;
  const UpdateSummary to_the_end = UpdateWith(Endless(), &at_the_end);
  EXPECT_EQ(to_the_end.message.find("Gradient"), std::string::npos) << to_the_end.message;
  for (const double tolerance : {1e-1, 1e-3, 1e-5}) {
    IncrementalOptions options = Endless();
    options.gradient_tolerance = tolerance;
    const UpdateSummary summary = UpdateWith(options, &gradient);
    EXPECT_EQ(summary.termination, Termination::kConvergence);
    EXPECT_EQ(summary.message.rfind("Gradient tolerance reached.", 0), 0u) << summary.message;
    EXPECT_LE(gradient, tolerance);
    EXPECT_GT(gradient, at_the_end);
    EXPECT_LT(summary.num_iterations, to_the_end.num_iterations);
  }
}

TEST(Tolerances, AShortStepEndsAnUpdate) {
  double gradient = 0.0;
  const UpdateSummary to_the_end = UpdateWith(Endless(), &gradient);
  int iterations = 0;
  for (const double tolerance : {1e-1, 1e-4}) {
    IncrementalOptions options = Endless();
    options.parameter_tolerance = tolerance;
    const UpdateSummary summary = UpdateWith(options, &gradient);
    EXPECT_EQ(summary.termination, Termination::kConvergence);
    EXPECT_EQ(summary.message.rfind("Parameter tolerance reached.", 0), 0u) << summary.message;
    EXPECT_GT(summary.num_iterations, iterations);
    iterations = summary.num_iterations;
  }
  EXPECT_LT(iterations, to_the_end.num_iterations);
}

// Two gradients that overflow, one each way: their sum is no number, and not small.
TEST(Tolerances, AGradientThatIsNoNumberEndsNothing) {
  IncrementalOptions options = Endless();
  options.gradient_tolerance = 1e-3;
  int num_rows = 0;
  options.callback = [&](const UpdateIteration& row) {
    ++num_rows;
    EXPECT_FALSE(row.gradient_max_norm <= options.gradient_tolerance) << row.gradient_max_norm;
    return ObserverAction::kContinue;
  };
  const double start = 0.0;
  IncrementalSolver solver(options);
  const auto family = solver.AddFamily(test::ScalarFamily(
      [](int i, double x) { return 1e300 * x + (i == 0 ? 1e10 : -1e10); }, 1e300));
  GraphEdit edit(solver.graph());
  const VariableId x = edit.AddVariable(&start, 1, Role::kFrame);
  edit.AddFactor(family, 0, {x});
  edit.AddFactor(family, 0, {x});
  ASSERT_TRUE(solver.Apply(edit).ok());
  const UpdateSummary summary = solver.Update();
  EXPECT_NE(summary.message.rfind("Gradient", 0), 0u) << summary.message;
  EXPECT_GT(num_rows, 0);
}

TEST(Tolerances, AtTheMinimumThereIsNothingToDo) {
  IncrementalOptions options = Endless();
  options.gradient_tolerance = 1e-4;
  IncrementalBundle bundle(options, 22);
  bundle.Grow(5, 12, 3);
  ASSERT_EQ(bundle.solver.Update().termination, Termination::kConvergence);
  const std::vector<double> values = bundle.Values();
  // The same value once more is an edit.
  const VariableId frame = bundle.frames()[0];
  bundle.SetValues(frame, {bundle.solver.Values(frame), bundle.solver.Values(frame) + 6});
  bundle.Apply();
  const UpdateSummary again = bundle.solver.Update();
  EXPECT_EQ(again.message.rfind("Gradient tolerance reached.", 0), 0u) << again.message;
  EXPECT_EQ(again.num_iterations, 0);
  EXPECT_EQ(bundle.Values(), values);
  // A tighter one is not reached yet.
  options.gradient_tolerance = 1e-9;
  bundle.solver.SetOptions(options);
  EXPECT_GT(bundle.solver.Update().num_iterations, 0);
}

// No system was solved where the gradient or the last step has ended an Update: what is left there
// is not known, and the next one must not go by it.
TEST(Tolerances, WhatHasEndedAnUpdateDoesNotSayWhatIsLeft) {
  for (const bool by_gradient : {true, false}) {
    IncrementalOptions options;
    options.batch_share = 2.0;
    IncrementalBundle bundle(options, 1);
    for (int i = 0; i < 8; ++i) {
      bundle.AddFrame();
    }
    bundle.Apply();
    ASSERT_EQ(bundle.solver.Update().termination, Termination::kConvergence);
    IncrementalOptions loose = options;
    (by_gradient ? loose.gradient_tolerance : loose.parameter_tolerance) = 1e6;
    bundle.solver.SetOptions(loose);
    bundle.AddPrior(bundle.frames()[3], 10.0);
    bundle.Apply();
    const UpdateSummary early = bundle.solver.Update();
    ASSERT_EQ(early.message.rfind(by_gradient ? "Gradient" : "Parameter", 0), 0u) << early.message;
    EXPECT_EQ(early.remaining_decrease, -1.0);
    EXPECT_NE(early.FullReport().find(" unknown\n"), std::string::npos) << early.FullReport();
    // Next to nothing comes, but much is left of before.
    bundle.solver.SetOptions(options);
    bundle.AddPrior(bundle.frames()[3], 1e-6);
    bundle.Apply();
    const UpdateSummary next = bundle.solver.Update();
    EXPECT_EQ(next.termination, Termination::kConvergence) << next.message;
    const double minimum = bundle.FreshMinimum(options, /*from_values_held=*/true);
    EXPECT_NEAR(next.final_cost, minimum, 1e-5 * minimum) << by_gradient;
  }
}

TEST(Tolerances, AreValidated) {
  IncrementalOptions options;
  options.gradient_tolerance = -1.0;
  EXPECT_EQ(options.Validate().message,
            "IncrementalOptions::gradient_tolerance = -1 but must be >= 0");
  options = {};
  options.parameter_tolerance = -1.0;
  EXPECT_EQ(options.Validate().message,
            "IncrementalOptions::parameter_tolerance = -1 but must be >= 0");
}

}  // namespace
}  // namespace inceres::test
