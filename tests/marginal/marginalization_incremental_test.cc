// Marginalization on the living solver: it goes on as if it had always had the prior.
#include <algorithm>

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include "inceres/problem/losses.h"
#include "inceres/problem/manifolds.h"
#include "inceres/solver/marginalization.h"
#include "inceres/solver/solver.h"
#include "incremental/incremental_bundle.h"
#include "marginal/linear_world.h"
#include "support/dense_oracle.h"
#include "support/values_held.h"

namespace inceres::test {
namespace {

using test::AtValuesHeld;

using Eigen::MatrixXd;
using Eigen::VectorXd;

IncrementalOptions Tight() {
  IncrementalOptions options;
  options.function_tolerance = 1e-10;
  options.max_num_iterations = 200;
  options.batch_share = 2.0;
  return options;
}

double BatchMinimum(FactorGraph graph) {
  SolverOptions options;
  options.function_tolerance = 1e-14;
  options.gradient_tolerance = 0.0;
  options.parameter_tolerance = 0.0;
  options.max_num_iterations = 200;
  const Summary summary = Solve(options, &graph);
  EXPECT_TRUE(summary.IsSolutionUsable()) << summary.message << summary.detail;
  return summary.final_cost;
}

TEST(IncrementalMarginalization, OfALinearProblemLeavesTheOptimumWhereItWas) {
  Random random(9);
  IncrementalSolver solver(Tight());
  LinearFamilies families;
  const auto add_family = [&](const auto& family) { return solver.AddFamily(family); };
  const auto priors = families.For(3, {3}, add_family);
  const auto links = families.For(3, {3, 3}, add_family);
  const auto views = families.For(2, {3, 2}, add_family);
  GraphEdit edit(solver.graph());
  std::vector<VariableId> frames;
  std::vector<VariableId> landmarks;
  const std::vector<double> zero(3, 0.0);
  for (int i = 0; i < 6; ++i) {
    frames.push_back(edit.AddVariable(zero.data(), 3, Role::kFrame));
    edit.AddFactor(priors, {RandomMatrix(&random, 3, 3), RandomMatrix(&random, 3, 1)},
                   {frames.back()});
    if (i > 0) {
      edit.AddFactor(links, {RandomMatrix(&random, 3, 6), RandomMatrix(&random, 3, 1)},
                     {frames[i - 1], frames[i]});
    }
  }
  for (int l = 0; l < 10; ++l) {
    landmarks.push_back(edit.AddVariable(zero.data(), 2, Role::kLandmark));
    for (int v = 0; v < 3; ++v) {
      edit.AddFactor(views, {RandomMatrix(&random, 2, 5), RandomMatrix(&random, 2, 1)},
                     {frames[(l + v) % 6], landmarks.back()});
    }
  }
  ASSERT_TRUE(solver.Apply(edit).ok());
  ASSERT_EQ(solver.Update().termination, Termination::kConvergence);
  std::vector<std::vector<double>> before;
  for (VariableId id = 0; id < solver.graph().num_variables(); ++id) {
    before.emplace_back(solver.Values(id), solver.Values(id) + solver.graph().AmbientSize(id));
  }
  const double cost = solver.cost();
  const MarginalizationSummary summary = solver.Marginalize(
      OldestFrameRule(solver.graph(), {frames[0]}, /*min_factors=*/0), MarginalizationOptions());
  ASSERT_TRUE(summary.status.ok()) << summary.status.message;
  EXPECT_EQ(summary.num_cached_factors,
            summary.num_factors);  // a linear problem's Jacobians do not age
  const UpdateSummary update = solver.Update();
  EXPECT_EQ(update.termination, Termination::kConvergence);
  EXPECT_EQ(update.num_relinearized_factors, 1);  // the prior
  for (VariableId id = 0; id < solver.graph().num_variables(); ++id) {
    for (int k = 0; solver.graph().HasVariable(id) && k < solver.graph().AmbientSize(id); ++k) {
      EXPECT_NEAR(solver.Values(id)[k],
                  before[static_cast<std::size_t>(id)][static_cast<std::size_t>(k)], 1e-5);
    }
  }
  EXPECT_NEAR(solver.cost() + summary.fixed_cost, cost, 1e-9 * cost);
  EXPECT_NEAR(solver.cost(), BatchMinimum(AtValuesHeld(solver)), 1e-9 * solver.cost());
}

// A window over a nonlinear problem slides for forty frames; every Update ends where a batch solve
// of the same problem, prior included, ends, and nothing grows. The first frame is held by an
// information of `stiff`.
void SlideWindow(double sqrt_stiff, const MarginalizationOptions& options,
                 std::shared_ptr<const Loss> loss) {
  IncrementalBundle bundle(Tight(), 5);
  const auto grow = [&] { bundle.Grow(1, 12, 3, loss); };
  bundle.Grow(8, 60, 3, loss);
  if (sqrt_stiff > 0.0) {
    bundle.AddPrior(bundle.frames()[0], sqrt_stiff);
    bundle.Apply();
  }
  int num_variables = 0;
  int num_families = 0;
  int num_cached = 0;
  for (int k = 0; k < 40; ++k) {
    ASSERT_EQ(bundle.solver.Update().termination, Termination::kConvergence) << k;
    const FactorGraph copy = AtValuesHeld(bundle.solver);
    const double minimum = BatchMinimum(copy);
    ASSERT_NEAR(bundle.solver.cost(), minimum, 1e-7 * minimum) << k;
    const MarginalizationSummary summary = bundle.solver.Marginalize(
        OldestFrameRule(bundle.solver.graph(), {bundle.frames()[static_cast<std::size_t>(k)]},
                        /*min_factors=*/0),
        options);
    ASSERT_TRUE(summary.status.ok()) << k << ": " << summary.status.message;
    num_cached += summary.num_cached_factors;
    bundle.edit().Restart();
    grow();
    if (k == 20) {
      num_variables = bundle.solver.graph().num_variables();
      num_families = bundle.solver.graph().num_families();
    }
  }
  EXPECT_LE(bundle.solver.graph().num_variables(), num_variables + 10);
  EXPECT_LE(bundle.solver.graph().num_families(), num_families + 2);
  EXPECT_GT(num_cached, 40);
}

TEST(IncrementalMarginalization, AWindowSlides) {
  SlideWindow(0.0, MarginalizationOptions(), nullptr);
}

TEST(IncrementalMarginalization, AWindowSlidesWithAPriorOf1e14) {
  SlideWindow(1e7, MarginalizationOptions(), nullptr);
}

TEST(IncrementalMarginalization, AWindowSlidesWithRobustLossesAndFirstEstimates) {
  MarginalizationOptions options;
  options.first_estimate_jacobians = true;
  SlideWindow(1e3, options, std::make_shared<CauchyLoss>(1.0));
}

// The caches give the prior that evaluation gives.
TEST(IncrementalMarginalization, CachedRowsAreThoseOfTheFactors) {
  for (const bool exact : {true, false}) {
    IncrementalOptions options = Tight();
    options.relinearization_share = exact ? 0.0 : 0.1;
    IncrementalBundle bundle(options, 6);
    bundle.Grow(8, 60, 3, std::make_shared<CauchyLoss>(0.5));
    ASSERT_EQ(bundle.solver.Update().termination, Termination::kConvergence);
    FactorGraph copy = AtValuesHeld(bundle.solver);
    const MarginalizationRequest request =
        OldestFrameRule(bundle.solver.graph(), {bundle.frames()[0]}, /*min_factors=*/0);
    const MarginalizationSummary live =
        bundle.solver.Marginalize(request, MarginalizationOptions());
    const MarginalizationSummary fresh = Marginalize(request, MarginalizationOptions(), &copy);
    ASSERT_TRUE(live.status.ok() && fresh.status.ok());
    EXPECT_GT(live.num_cached_factors, 0);
    EXPECT_EQ(fresh.num_cached_factors, 0);
    const LinearPrior& cached = *FindLinearPrior(bundle.solver.graph(), live.prior);
    const LinearPrior& evaluated = *FindLinearPrior(copy, fresh.prior);
    // A last step whose error rounds to zero leaves the rows as they were before it.
    const double tolerance = exact ? 1e-8 : 1e-4;
    EXPECT_LT(RelativeError(InformationOf(cached), InformationOf(evaluated)), tolerance);
    EXPECT_LT(RelativeError(GradientOf(cached), GradientOf(evaluated)), tolerance);
  }
}

TEST(IncrementalMarginalization, FailureLeavesTheSolverAsItWas) {
  IncrementalBundle bundle(Tight(), 7);
  bundle.Grow(6, 30, 3);
  const VariableId lonely = bundle.AddLandmark({bundle.frames()[0]});
  bundle.Apply();
  bundle.solver.Update();
  const std::vector<double> values = bundle.Values();
  const double cost = bundle.solver.cost();
  const MarginalizationSummary failed = bundle.solver.Marginalize(
      OldestFrameRule(bundle.solver.graph(), {bundle.frames()[0]}, /*min_factors=*/0),
      MarginalizationOptions());
  EXPECT_EQ(failed.status.code, StatusCode::kSingular);
  EXPECT_EQ(failed.offenders, std::vector<VariableId>{lonely});
  EXPECT_EQ(bundle.solver.graph().num_factors(), bundle.num_factors());
  EXPECT_EQ(bundle.Values(), values);
  EXPECT_EQ(bundle.solver.cost(), cost);
  EXPECT_EQ(bundle.solver.Update().message, "Nothing has changed since the last Update converged.");
  IncrementalOptions bad;
  bad.num_threads = 0;
  IncrementalSolver invalid(bad);
  EXPECT_EQ(invalid.Marginalize({}, MarginalizationOptions()).status.code,
            StatusCode::kInvalidArgument);
}

// A factor that does not point where it is linearized any more, after new values without an Update.
TEST(IncrementalMarginalization, ChangedFactorsAreEvaluated) {
  IncrementalBundle bundle(Tight(), 8);
  bundle.Grow(6, 30, 3);
  bundle.solver.Update();
  bundle.SetValues(bundle.frames()[1], std::vector<double>(6, 0.3));
  bundle.Apply();
  FactorGraph copy = AtValuesHeld(bundle.solver);
  const MarginalizationRequest request =
      OldestFrameRule(bundle.solver.graph(), {bundle.frames()[0]}, /*min_factors=*/0);
  const MarginalizationSummary live = bundle.solver.Marginalize(request, MarginalizationOptions());
  const MarginalizationSummary fresh = Marginalize(request, MarginalizationOptions(), &copy);
  ASSERT_TRUE(live.status.ok() && fresh.status.ok());
  EXPECT_LT(live.num_cached_factors, live.num_factors);
  const VectorXd expected = GradientOf(*FindLinearPrior(copy, fresh.prior));
  EXPECT_LT(
      RelativeError(GradientOf(*FindLinearPrior(bundle.solver.graph(), live.prior)), expected),
      1e-4);
}

// JᵀJ of a prior is formed once: on a manifold too, however far its variables turn and however
// eager the solver is.
TEST(IncrementalMarginalization, ThePriorIsNeverRelinearized) {
  for (const RelinearizationRule rule :
       {RelinearizationRule::kResidualError, RelinearizationRule::kStepSize}) {
    IncrementalOptions options = Tight();
    options.relinearization = rule;
    options.relinearization_share = 0.0;
    options.relinearization_step = 1e-12;
    IncrementalSolver solver(options);
    Random random(10);
    const auto smooth = solver.AddFamily(
        std::make_shared<SmoothFamily>(7, std::vector<FactorFamily::Slot>{{3, 3}, {7, 6}}));
    const auto anchor = solver.AddFamily(
        std::make_shared<SmoothFamily>(4, std::vector<FactorFamily::Slot>{{3, 3}}));
    const auto pull = solver.AddFamily(
        std::make_shared<SmoothFamily>(7, std::vector<FactorFamily::Slot>{{7, 6}}));
    GraphEdit edit(solver.graph());
    const double zero[3] = {};
    const double pose[7] = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0};
    const VariableId gone = edit.AddVariable(zero, 3, Role::kFrame);
    const VariableId kept =
        edit.AddVariable(pose, 7, Role::kFrame, std::make_shared<PoseManifold>());
    edit.AddFactor(smooth, smooth->MakeMeasurement(&random), {gone, kept});
    edit.AddFactor(anchor, anchor->MakeMeasurement(&random), {gone});
    ASSERT_TRUE(solver.Apply(edit).ok());
    solver.Update();
    MarginalizationRequest request;
    request.marginalized = {gone};
    ASSERT_TRUE(solver.Marginalize(request, MarginalizationOptions()).status.ok());
    edit.Restart();
    SmoothFamily::Measurement strong = pull->MakeMeasurement(&random);
    edit.AddFactor(pull, strong, {kept});
    ASSERT_TRUE(solver.Apply(edit).ok());
    const UpdateSummary summary = solver.Update();
    EXPECT_GT(summary.num_iterations, 1);
    EXPECT_GT(summary.num_relinearized_factors, 2);
    EXPECT_LE(summary.num_relinearized_factors,
              2 + summary.num_iterations);  // both at first, then the pull alone
  }
}

}  // namespace
}  // namespace inceres::test
