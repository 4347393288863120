// Bounds in the incremental solver: no value ever leaves them, and an Update ends at the optimum
// within them.
#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include <gtest/gtest.h>

#include "inceres/problem/manifolds.h"
#include "inceres/solver/solver.h"
#include "incremental/incremental_bundle.h"
#include "support/classic_functors.h"
#include "support/dense_oracle.h"
#include "support/test_families.h"

namespace inceres::test {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

IncrementalOptions Tight(double batch_share) {
  IncrementalOptions options;
  options.batch_share = batch_share;
  options.function_tolerance = 1e-14;
  options.max_num_iterations = 300;
  return options;
}

// Of the recorded problem at the values held: how far it is from the first-order conditions.
struct Conditions {
  double largest = 0.0;  // max |x − (x − g clamped)|
  double gradient = 0.0;
};

Conditions Look(const FactorGraph& graph) {
  const std::vector<VariableId> moving = MovingVariables(graph);
  const DenseOracle oracle(graph, moving);
  Conditions found;
  Eigen::Index at = 0;
  for (const VariableId id : moving) {
    const VariableBounds* bounds = graph.bounds(id);
    for (int k = 0; k < graph.AmbientSize(id); ++k, ++at) {
      const double x = graph.Values(id)[k];
      const auto entry = static_cast<std::size_t>(k);
      const double lower = bounds != nullptr ? bounds->lower[entry] : -kInfinity;
      const double upper = bounds != nullptr ? bounds->upper[entry] : kInfinity;
      found.gradient = std::max(found.gradient, std::fabs(oracle.g[at]));
      found.largest =
          std::max(found.largest, std::fabs(x - std::clamp(x - oracle.g[at], lower, upper)));
    }
  }
  return found;
}

class BoundedUpdate : public testing::TestWithParam<double> {};

TEST_P(BoundedUpdate, AnUpdateEndsAtTheOptimumWithinThem) {
  for (unsigned seed = 1; seed <= 6; ++seed) {
    IncrementalBundle bundle(Tight(GetParam()), seed);
    bundle.Grow(8, 24, 3);
    bundle.BoundSome(bundle.frames(), 2);
    bundle.BoundSome(bundle.landmarks(), 2);
    bundle.Apply();
    const UpdateSummary summary = bundle.solver.Update();
    EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
    const Conditions found = Look(bundle.Graph());
    EXPECT_GT(CountOnBounds(bundle.Graph()), 10);
    EXPECT_GT(found.gradient, 1e-2) << "bounds hold something back";
    EXPECT_LT(found.largest, 1e-5) << "seed " << seed;
    // That of the batch solver, which creeps along bounds, and may end before it.
    const Summary batch = bundle.SolveInBatch(/*from_values_held=*/false);
    EXPECT_LE(summary.final_cost, batch.final_cost * (1.0 + 1e-9)) << "seed " << seed;
    EXPECT_NEAR(bundle.SolveInBatch(/*from_values_held=*/true).final_cost, summary.final_cost,
                1e-9 * summary.final_cost)
        << "which finds nothing to gain here";
  }
}

TEST_P(BoundedUpdate, WithTheDefaultToleranceAsMuchIsLeftUndoneAsWithoutThem) {
  for (unsigned seed = 1; seed <= 6; ++seed) {
    IncrementalOptions options;
    options.batch_share = GetParam();
    IncrementalBundle bundle(options, seed);
    bundle.Grow(10, 30, 3);
    bundle.BoundSome(bundle.frames(), 2);
    bundle.BoundSome(bundle.landmarks(), 3);
    bundle.Apply();
    const UpdateSummary summary = bundle.solver.Update();
    EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
    EXPECT_LE(summary.final_cost,
              bundle.FreshMinimum(Tight(2.0)) * (1.0 + options.function_tolerance))
        << "seed " << seed;
  }
}

INSTANTIATE_TEST_SUITE_P(BatchShare, BoundedUpdate, testing::Values(0.5, 2.0));

TEST(Bounds, WhatIsLiftedGoesOnToTheFreeOptimum) {
  IncrementalBundle bundle(Tight(2.0), 3);
  bundle.Grow(6, 16, 3);
  const double free_cost = bundle.solver.Update().final_cost;
  std::vector<VariableId> all = bundle.frames();
  all.insert(all.end(), bundle.landmarks().begin(), bundle.landmarks().end());
  for (const VariableId id : all) {
    const int size = bundle.solver.graph().AmbientSize(id);
    const double* x = bundle.solver.Values(id);
    std::vector<double> upper(x, x + size);
    for (double& bound : upper) {
      bound -= 0.02;  // the values held are outside
    }
    bundle.SetBounds(id, {}, upper);
  }
  bundle.Apply();
  EXPECT_GT(CountOnBounds(bundle.Graph()), 0) << "what was outside went to the bound at once";
  const UpdateSummary bounded = bundle.solver.Update();
  EXPECT_EQ(bounded.termination, Termination::kConvergence) << bounded.message;
  EXPECT_GT(bounded.final_cost, 1.0001 * free_cost);
  for (const VariableId id : all) {
    bundle.SetBounds(id, {}, {});
  }
  bundle.Apply();
  const UpdateSummary lifted = bundle.solver.Update();
  EXPECT_NEAR(lifted.final_cost, free_cost, 1e-9 * free_cost);
}

// Rosenbrock's valley against a wall: where the batch solver creeps, this one comes to the foot.
TEST(Bounds, RosenbrockAgainstAWall) {
  IncrementalSolver solver(Tight(2.0));
  const auto family = solver.AddFamily(JetFamily<2, 2>(RosenbrockTerm()));
  GraphEdit edit(solver.graph());
  const double start[] = {-1.2, 1.0};
  const double upper[] = {0.5, 9.0};
  const VariableId x = edit.AddVariable(start, 2, Role::kFrame);
  edit.AddFactor(family, 0, {x});
  edit.SetBounds(x, nullptr, upper);
  ASSERT_TRUE(solver.Apply(edit).ok());
  const UpdateSummary summary = solver.Update();
  EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
  EXPECT_EQ(solver.Values(x)[0], 0.5) << "to the last bit";
  EXPECT_NEAR(solver.Values(x)[1], 0.25, 1e-6);
  EXPECT_NEAR(summary.final_cost, 0.125, 1e-9);
}

TEST(Bounds, TheProjectedGradientEndsAnUpdate) {
  IncrementalOptions options = Tight(2.0);
  options.gradient_tolerance = 1e-4;
  IncrementalBundle bundle(options, 4);
  bundle.Grow(8, 24, 3);
  bundle.BoundSome(bundle.frames(), 1);
  bundle.Apply();
  const UpdateSummary summary = bundle.solver.Update();
  EXPECT_EQ(summary.message.rfind("Gradient tolerance reached.", 0), 0u) << summary.message;
  const Conditions found = Look(bundle.Graph());
  EXPECT_LE(found.largest, 1e-4);
  EXPECT_GT(found.gradient, 1e-2) << "that of what is held";
}

TEST(Bounds, TheSameBitsForAnyNumberOfThreads) {
  std::vector<double> one_thread;
  for (const int num_threads : {1, 3}) {
    IncrementalOptions options = Tight(0.5);
    options.num_threads = num_threads;
    IncrementalBundle bundle(options, 5);
    bundle.Grow(8, 24, 3);
    bundle.BoundSome(bundle.frames(), 1);
    bundle.BoundSome(bundle.landmarks(), 1);
    bundle.Apply();
    bundle.solver.Update();
    one_thread = one_thread.empty() ? bundle.Values() : one_thread;
    EXPECT_EQ(bundle.Values(), one_thread);
  }
}

TEST(Bounds, WhatIsHeldHasNoCovariance) {
  IncrementalBundle bundle(Tight(2.0), 6);
  bundle.Grow(6, 16, 3);
  bundle.BoundSome(bundle.frames(), 1);
  bundle.Apply();
  bundle.solver.Update();
  ASSERT_GT(CountOnBounds(bundle.Graph()), 0);
  LiveCovariance covariance;
  const Status status =
      bundle.solver.MarginalCovariance(bundle.frames()[1], LiveCovarianceOptions(), &covariance);
  EXPECT_EQ(status.code, StatusCode::kUnavailable) << status.message;
  EXPECT_NE(status.message.find("bounds"), std::string::npos) << status.message;
  for (const VariableId id : bundle.frames()) {
    bundle.SetBounds(id, {}, {});
  }
  bundle.Apply();
  bundle.solver.Update();
  const Status lifted =
      bundle.solver.MarginalCovariance(bundle.frames()[1], LiveCovarianceOptions(), &covariance);
  EXPECT_TRUE(lifted.ok()) << lifted.message;
}

// Bounds of a constant do not count, so nothing is held at them any more.
TEST(Bounds, WhatIsHeldAndThenMadeConstantIsInNobodysWay) {
  for (const Role role : {Role::kFrame, Role::kLandmark}) {
    IncrementalBundle bundle(Tight(2.0), 1);
    bundle.Grow(8, 24, 3);
    bundle.solver.Update();
    const VariableId id = role == Role::kFrame ? bundle.frames()[3] : bundle.landmarks()[3];
    const int size = bundle.solver.graph().AmbientSize(id);
    std::vector<double> lower(bundle.solver.Values(id), bundle.solver.Values(id) + size);
    // The optimum is below.
    std::for_each(lower.begin(), lower.end(), [](double& bound) { bound += 0.1; });
    bundle.SetBounds(id, lower, {});
    bundle.Apply();
    bundle.solver.Update();
    const VariableId asked = bundle.frames()[1];
    LiveCovariance covariance;
    ASSERT_EQ(bundle.solver.MarginalCovariance(asked, LiveCovarianceOptions(), &covariance).code,
              StatusCode::kUnavailable);
    bundle.SetConstant(id, true);
    bundle.Apply();
    bundle.solver.Update();
    const Status constant =
        bundle.solver.MarginalCovariance(asked, LiveCovarianceOptions(), &covariance);
    EXPECT_TRUE(constant.ok()) << constant.message;
    // Set free it is held again.
    bundle.SetConstant(id, false);
    bundle.Apply();
    bundle.solver.Update();
    EXPECT_EQ(bundle.solver.MarginalCovariance(asked, LiveCovarianceOptions(), &covariance).code,
              StatusCode::kUnavailable);
  }
}

// A coordinate that its manifold holds is none of the tangent space: bounds are by value.
TEST(Bounds, OfAVariableWithConstantCoordinates) {
  IncrementalSolver solver(Tight(2.0));
  const double start[] = {1.0, 2.0, 3.0};
  const double lower[] = {-kInfinity, -kInfinity, 2.5};
  const auto pull = solver.AddFamily(std::make_shared<FunctionFamily>(
      3, std::vector<FactorFamily::Slot>{{3, 2}},
      [](int, const double* const* parameters, double* residuals, double** jacobians) {
        std::copy(parameters[0], parameters[0] + 3, residuals);
        for (int k = 0; jacobians != nullptr && jacobians[0] != nullptr && k < 9; ++k) {
          jacobians[0][k] = k % 4 == 0 ? 1.0 : 0.0;
        }
        return true;
      }));
  GraphEdit edit(solver.graph());
  const VariableId x = edit.AddVariable(start, 3, Role::kFrame,
                                        std::make_shared<SubsetManifold>(3, std::vector<int>{0}));
  edit.AddFactor(pull, 0, {x});
  edit.SetBounds(x, lower, nullptr);
  const Status applied = solver.Apply(edit);
  ASSERT_TRUE(applied.ok()) << applied.message;
  const UpdateSummary summary = solver.Update();
  EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
  EXPECT_EQ(solver.Values(x)[0], 1.0);
  EXPECT_NEAR(solver.Values(x)[1], 0.0, 1e-6);
  EXPECT_EQ(solver.Values(x)[2], 2.5);
}

TEST(Bounds, WhatIsWrongWithThemIsSaidAndNothingChanges) {
  const double one[] = {1.0, 1.0, 1.0};
  const double two[] = {2.0, 2.0, 2.0};
  const double nan[] = {0.0, std::nan(""), 0.0};
  for (const bool updated : {false, true}) {
    IncrementalBundle bundle(Tight(2.0), 7);
    bundle.Grow(4, 8, 3);
    if (updated) {
      bundle.solver.Update();
    }
    const std::vector<double> values = bundle.Values();
    const VariableId landmark = bundle.landmarks()[0];
    const auto refused = [&](const auto& set, const char* why) {
      GraphEdit edit(bundle.solver.graph());
      set(&edit);
      const Status status = bundle.solver.Apply(edit);
      EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
      EXPECT_NE(status.message.find(why), std::string::npos) << status.message;
      EXPECT_EQ(bundle.Values(), values);
      EXPECT_EQ(bundle.solver.graph().bounds(landmark), nullptr);
    };
    refused([&](GraphEdit* edit) { edit->SetBounds(landmark, two, one); }, "not below");
    refused([&](GraphEdit* edit) { edit->SetBounds(landmark, one, one); }, "not below");
    refused([&](GraphEdit* edit) { edit->SetBounds(landmark, nan, two); }, "nan");
    refused([&](GraphEdit* edit) { edit->SetBounds(4711, one, two); }, "4711");
    refused(
        [&](GraphEdit* edit) {
          const double pose[] = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0};
          const VariableId id =
              edit->AddVariable(pose, 7, Role::kFrame, std::make_shared<PoseManifold>());
          edit->SetBounds(id, pose, nullptr);
        },
        "manifold");
  }
}

}  // namespace
}  // namespace inceres::test
