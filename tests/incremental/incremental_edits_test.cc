// Edits that touch little, or nothing. (Where they end, whatever they are: RandomEdits.)

#include <cmath>
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/factors/point_reprojection.h"
#include "inceres/problem/losses.h"
#include "inceres/problem/manifolds.h"
#include "incremental/incremental_bundle.h"
#include "support/test_families.h"

namespace inceres {
namespace {

using test::IncrementalBundle;

// batch_share 1: the batch solver never helps.
IncrementalOptions Tight() {
  IncrementalOptions options;
  options.function_tolerance = 1e-9;
  options.max_num_iterations = 200;
  options.batch_share = 1.0;
  return options;
}

// Converged, at the minimum a batch solve and a fresh solver find from the start values.
void ExpectBatchMinimum(IncrementalBundle* bundle) {
  const UpdateSummary summary = bundle->solver.Update();
  ASSERT_EQ(summary.termination, Termination::kConvergence) << summary.message;
  ASSERT_EQ(bundle->solver.graph().num_factors(), bundle->num_factors());
  ASSERT_EQ(summary.final_cost, bundle->solver.cost());
  const double minimum = bundle->SolveInBatch(/*from_values_held=*/true).final_cost;
  EXPECT_LE(summary.final_cost - minimum, 1e-6 * minimum);
  EXPECT_NEAR(bundle->SolveInBatch(/*from_values_held=*/false).final_cost, minimum, 1e-6 * minimum);
  EXPECT_NEAR(bundle->FreshMinimum(Tight()), minimum, 1e-6 * minimum);
}

// Its memory may be read only, as that of a constexpr array is: the batch phase writes all else
// back.
TEST(IncrementalEdits, ABorrowedConstantIsNeverWritten) {
  static constexpr double kIdentity[7] = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0};
  constexpr double kFirst[7] = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0};
  constexpr double kSecond[7] = {1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0};
  constexpr double kPoint[3] = {0.0, 0.0, 4.0};
  IncrementalSolver solver(IncrementalOptions{});
  const auto sights = solver.AddFamily(std::make_shared<PointReprojectionFamily>(PinholeCamera()));
  const auto manifold = std::make_shared<PoseManifold>();
  GraphEdit edit(solver.graph());
  const VariableId on_body = edit.AddBorrowedConstant(kIdentity, 7);
  const VariableId point = edit.AddVariable(kPoint, 3, Role::kLandmark);
  for (const double* pose : {kFirst, kSecond}) {
    const VariableId frame = edit.AddVariable(pose, 7, Role::kFrame, manifold);
    edit.SetConstant(frame, true);
    edit.AddFactor(sights, {{-pose[0] / 5.0, 0.1}, {1.0, 0.0, 1.0}}, {frame, on_body, point});
  }
  ASSERT_TRUE(solver.Apply(edit).ok());
  const UpdateSummary summary = solver.Update();
  EXPECT_GT(summary.num_batch_iterations, 0);
  EXPECT_NEAR(solver.Values(point)[2], 5.0, 1e-6) << summary.message;
  EXPECT_EQ(solver.Values(on_body), kIdentity);
}

// A constant is a mask over the system.
TEST(IncrementalEdits, ThousandsOfConstantsToggleWithoutAnEvaluation) {
  IncrementalBundle bundle(Tight(), 7);
  bundle.Grow(20, 2000, 3);
  ExpectBatchMinimum(&bundle);
  const std::vector<double> before = bundle.Values();
  for (const VariableId landmark : bundle.landmarks()) {
    bundle.SetConstant(landmark, true);
  }
  for (int i = 0; i < 20; i += 2) {
    bundle.SetConstant(bundle.frames()[i], true);
  }
  bundle.Apply();
  const UpdateSummary held = bundle.solver.Update();
  EXPECT_EQ(held.termination, Termination::kConvergence);
  EXPECT_EQ(held.num_relinearized_factors, 0) << "at the minimum already, and nothing has moved";
  EXPECT_EQ(bundle.Values(), before);

  // One frame is measured anew: with its landmarks held, its own factors are all that counts.
  const VariableId frame = bundle.frames()[5];
  bundle.AddPrior(frame, 3.0);
  bundle.Apply();
  const UpdateSummary one = bundle.solver.Update();
  EXPECT_EQ(one.termination, Termination::kConvergence);
  EXPECT_GT(one.num_relinearized_factors, 0);
  EXPECT_LT(one.num_relinearized_factors, bundle.num_factors() / 4);
  const double minimum = bundle.SolveInBatch(true).final_cost;
  EXPECT_LE(one.final_cost - minimum, 1e-6 * minimum);

  for (const VariableId landmark : bundle.landmarks()) {
    bundle.SetConstant(landmark, false);
  }
  for (int i = 0; i < 20; i += 2) {
    bundle.SetConstant(bundle.frames()[i], false);
  }
  bundle.Apply();
  ExpectBatchMinimum(&bundle);
}

// As for a batch solver, that of a constant is asked of nobody: where its Jacobian is infinite, or
// its factor has none to give, no Update fails.
TEST(IncrementalEdits, NoJacobianByAConstantIsNeeded) {
  for (const Role role : {Role::kFrame, Role::kLandmark}) {
    for (const bool gives : {true, false}) {
      // √y + x at y = 0.
      const auto function = [gives](int, const double* const* p, double* f, double** J) {
        f[0] = std::sqrt(p[1][0]) + p[0][0] - 3.0;
        if (J != nullptr && J[0] != nullptr) {
          J[0][0] = 1.0;
        }
        if (J != nullptr && J[1] != nullptr) {
          J[1][0] = 0.5 / std::sqrt(p[1][0]);
          return gives || p[1][0] > 0.0;
        }
        return true;
      };
      IncrementalSolver solver(Tight());
      const auto sum = solver.AddFamily(std::make_shared<test::FunctionFamily>(
          1, std::vector<FactorFamily::Slot>{{1, 1}, {1, 1}}, function));
      const auto at_four =
          solver.AddFamily(test::ScalarFamily([](double y) { return y - 4.0; }, 1.0));
      const double start = 1.0, zero = 0.0;
      GraphEdit edit(solver.graph());
      const VariableId x = edit.AddVariable(&start, 1, Role::kFrame);
      const VariableId y = edit.AddVariable(&start, 1, role);
      edit.AddFactor(sum, 0, {x, y});
      edit.AddFactor(at_four, 0, {y});
      ASSERT_TRUE(solver.Apply(edit).ok());
      ASSERT_EQ(solver.Update().termination, Termination::kConvergence);
      ASSERT_NEAR(*solver.Values(x), 1.0, 1e-4);

      GraphEdit hold(solver.graph());
      hold.SetConstant(y, true);
      hold.SetValues(y, &zero);
      ASSERT_TRUE(solver.Apply(hold).ok());
      const UpdateSummary held = solver.Update();
      EXPECT_EQ(held.termination, Termination::kConvergence) << held.message;
      EXPECT_NEAR(*solver.Values(x), 3.0, 1e-4);
      EXPECT_NEAR(held.final_cost, 8.0, 1e-6);

      // Free again it has no place in S, and gets one; its Jacobian is infinite for everybody.
      GraphEdit free(solver.graph());
      free.SetConstant(y, false);
      ASSERT_TRUE(solver.Apply(free).ok());
      EXPECT_EQ(solver.Update().termination, Termination::kFailure);
      GraphEdit back(solver.graph());
      back.SetValues(y, &start);
      ASSERT_TRUE(solver.Apply(back).ok());
      EXPECT_EQ(solver.Update().termination, Termination::kConvergence);
      EXPECT_NEAR(*solver.Values(y), 4.0, 1e-4);
    }
  }
}

// An edit that is refused does not change a bit of what comes after.
TEST(IncrementalEdits, ARefusedEditNeverWas) {
  const auto play = [](bool with_failures, std::vector<double>* values,
                       std::vector<double>* costs) {
    IncrementalBundle bundle(IncrementalOptions{}, 8);
    bundle.Grow(6, 30, 3);
    for (int step = 0; step < 6; ++step) {
      if (with_failures) {
        const std::vector<double> held = bundle.Values();
        const double cost = bundle.solver.cost();
        GraphEdit bad(bundle.solver.graph());
        bad.RemoveVariable(bundle.frames()[1]);
        bad.SetConstant(bundle.landmarks()[0], true);
        const double here[6] = {1.0, 2.0, 3.0, 4.0, 5.0, 6.0};
        bad.AddVariable(here, 6, Role::kFrame);
        bad.SetValues(bundle.frames()[2], here);
        bad.SetLoss(bundle.Views()[3], std::make_shared<HuberLoss>(0.1));
        bad.RemoveVariable(99999);
        const Status status = bundle.solver.Apply(bad);
        EXPECT_FALSE(status.ok());
        EXPECT_NE(status.message.find("99999"), std::string::npos) << status.message;
        EXPECT_EQ(bundle.Values(), held);
        EXPECT_EQ(bundle.solver.cost(), cost);
      }
      costs->push_back(bundle.solver.Update().final_cost);
      bundle.RemoveVariable(bundle.frames().front());
      bundle.Grow(1, 4, 3);
    }
    costs->push_back(bundle.solver.Update().final_cost);
    *values = bundle.Values();
  };
  std::vector<double> values[2];
  std::vector<double> costs[2];
  play(false, &values[0], &costs[0]);
  play(true, &values[1], &costs[1]);
  EXPECT_EQ(values[0], values[1]);
  EXPECT_EQ(costs[0], costs[1]);
}

}  // namespace
}  // namespace inceres
