// An Update of a pose graph may end with a step that lets expect little of all to come, before
// anything behind it is linearized.

#include <array>
#include <cmath>
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/factors/planar_relative_pose.h"
#include "inceres/problem/graph_edit.h"
#include "inceres/solver/incremental_solver.h"
#include "inceres/solver/solver.h"
#include "incremental/stopping_rule.h"

namespace inceres::test {
namespace {

constexpr double kCost = 1.0;
constexpr double kTolerance = 1e-6;

internal::StoppingRule AfterOneStep() {
  internal::StoppingRule rule(internal::Tuning::Stop(), kTolerance, 0.0, 0.0, 0, kCost);
  rule.StepTaken(/*remaining=*/1.0, /*gain=*/1.0, /*gain_ratio=*/1.0, /*length=*/1.0);
  return rule;
}

TEST(ForeseenEnd, AStepThatPromisesAndMovesFarLessIsTheLast) {
  internal::StoppingRule rule = AfterOneStep();
  double rest = 0.0;
  EXPECT_FALSE(rule.ForeseesLittle(kCost, &rest));  // of one step no factor is known
  rule.StepTaken(1e-5, 1e-5, 1.0, 0.1);
  EXPECT_TRUE(rule.ForeseesLittle(kCost, &rest));
  EXPECT_NEAR(rest, 1e-7, 0.02e-7);  // steps shrink less than promises
}

TEST(ForeseenEnd, NotWhereLengthsHardlyFall) {
  internal::StoppingRule rule = AfterOneStep();
  double rest = 0.0;
  rule.StepTaken(1e-5, 1e-5, 1.0, 0.6);
  EXPECT_FALSE(rule.ForeseesLittle(kCost, &rest));
  rule = AfterOneStep();
  rule.StepTaken(1e-5, 1e-5, 1.0, 0.0);  // its length tells nothing
  EXPECT_FALSE(rule.ForeseesLittle(kCost, &rest));
}

TEST(ForeseenEnd, NotAfterABrokenPromiseOrARefusal) {
  internal::StoppingRule rule = AfterOneStep();
  double rest = 0.0;
  rule.StepTaken(1e-5, 0.8e-5, 0.8, 0.1);
  EXPECT_FALSE(rule.ForeseesLittle(kCost, &rest));
  rule = AfterOneStep();
  rule.StepRefused();
  rule.StepTaken(1e-5, 1e-5, 1.0, 0.1);
  EXPECT_FALSE(rule.ForeseesLittle(kCost, &rest));
}

// A ring of poses whose odometry drifts a little, and which closes in one Update.
class Ring {
 public:
  explicit Ring(const IncrementalOptions& options) : solver_(options) {
    handle_.family = std::make_shared<PlanarRelativePoseFamily>();
    handle_.id = solver_.AddFamily(handle_.family);
  }

  void Drive(int count) {
    GraphEdit edit(solver_.graph());
    for (int i = 0; i < count; ++i) {
      const int n = static_cast<int>(ids_.size());
      const double angle = (kTurn + kDrift) * n;
      const std::array<double, 3> start{10.0 * std::sin(angle), 10.0 * (1.0 - std::cos(angle)),
                                        angle};
      ids_.push_back(edit.AddVariable(start.data(), 3, Role::kFrame, nullptr));
      if (n == 0) {
        edit.SetConstant(ids_[0], true);
      } else {
        edit.AddFactor(handle_, Motion(kTurn + kDrift), {ids_[n - 1], ids_[n]}, nullptr);
      }
    }
    ASSERT_TRUE(solver_.Apply(edit).ok());
  }
  void Close() {
    GraphEdit edit(solver_.graph());
    edit.AddFactor(handle_, Motion(kTurn), {ids_.back(), ids_.front()}, nullptr);
    ASSERT_TRUE(solver_.Apply(edit).ok());
  }

  IncrementalSolver& solver() { return solver_; }
  VariableId last() const { return ids_.back(); }

 private:
  static constexpr double kTurn = 2.0 * 3.14159265358979 / 60, kDrift = 5e-5;

  static PlanarRelativePoseFamily::Measurement Motion(double turn) {
    const PlanarRelativePoseFamily::Measurement motion{
        {10.0 * std::sin(turn), 10.0 * (1.0 - std::cos(turn)), turn},
        {10.0, 0.0, 0.0, 0.0, 10.0, 0.0, 0.0, 0.0, 50.0}};
    return motion;
  }

  FamilyHandle<PlanarRelativePoseFamily> handle_;
  IncrementalSolver solver_;
  std::vector<VariableId> ids_;
};

// Whatever has moved is stale.
IncrementalOptions Options() {
  IncrementalOptions options;
  options.relinearization_share = 0.0;
  return options;
}

// Whether its last step has ended it: nothing was linearized behind it.
bool WasForeseen(const UpdateSummary& summary) {
  const UpdateIteration& last = summary.iterations.back();
  return summary.termination == Termination::kConvergence && last.step == UpdateStep::kFrames &&
         last.step_is_successful && last.num_relinearized_factors == 0 && !last.refreshed;
}

TEST(ForeseenEnd, EndsAtTheMinimumAndLeavesNothingToCovariances) {
  Ring ring(Options());
  ring.Drive(60);
  ASSERT_EQ(ring.solver().Update().termination, Termination::kConvergence);
  ring.Close();
  const UpdateSummary summary = ring.solver().Update();
  ASSERT_TRUE(WasForeseen(summary)) << summary.FullReport();
  EXPECT_GE(summary.remaining_decrease, 0.0);
  // What it foretells is there.
  FactorGraph graph = ring.solver().graph();
  for (VariableId id = 0; id < graph.num_variables(); ++id) {
    graph.SetValues(id, ring.solver().Values(id));
  }
  SolverOptions tight;
  tight.function_tolerance = 1e-14;
  const Summary minimum = Solve(tight, &graph);
  EXPECT_LE(summary.final_cost - minimum.final_cost, summary.remaining_decrease + 1e-12);
  // The factor that is left belongs to where the step began.
  LiveCovariance covariance;
  LiveCovarianceOptions as_factored;
  as_factored.accuracy = CovarianceAccuracy::kAsFactored;
  ASSERT_TRUE(ring.solver().Covariance({ring.last()}, as_factored, &covariance).ok());
  EXPECT_EQ(covariance.staleness.num_dirty_factors, 0);
}

TEST(ForeseenEnd, IsNoReasonForABatchSolve) {
  Ring ring(Options());
  ring.Drive(60);
  ring.solver().Update();
  ring.Close();
  ASSERT_TRUE(WasForeseen(ring.solver().Update()));
  ring.Drive(1);  // all others wait to be linearized, and are nothing new
  const UpdateSummary next = ring.solver().Update();
  EXPECT_EQ(next.termination, Termination::kConvergence);
  EXPECT_EQ(next.num_batch_iterations, 0);
  EXPECT_GT(next.num_relinearized_factors, 1);
}

}  // namespace
}  // namespace inceres::test
