// What a session takes for the same as last time, and what it does not: each rule with a problem
// that goes wrong without it.
#include <array>
#include <cmath>
#include <cstddef>
#include <deque>
#include <vector>

#include <gtest/gtest.h>

#include "adapters/session_support.h"
#include "adapters/test_problems.h"
#include "support/ceres_manifolds.h"

namespace inceres {
namespace {

using testing::Borrowing;
using testing::Pull;
using testing::Session;
using testing::Tug;

// Cost functions.

TEST(SessionRecognition, WhatIsUnchangedIsKeptAndOnlyItsResidualIsAskedFor) {
  Tug tug;
  const int before = tug.a.num_jacobian_calls;
  const int cost_only = tug.a.num_cost_only_calls;
  tug.Solve();
  EXPECT_EQ(tug.session.changes().num_kept_factors, 2);
  EXPECT_EQ(tug.session.changes().num_replaced_factors, 0);
  EXPECT_EQ(tug.a.num_jacobian_calls, before);
  EXPECT_GE(tug.a.num_cost_only_calls, cost_only + 1);
}

TEST(SessionRecognition, SameCostFunctionWithOtherContents) {
  Tug tug;
  tug.b.weight = 1.0;
  tug.Solve();
  EXPECT_EQ(tug.session.changes().num_replaced_factors, 1);
  EXPECT_EQ(tug.session.changes().num_kept_factors, 1);
  EXPECT_NEAR(tug.x, 2.5, 1e-6);
}

// What a solve has not moved is not asked for more often.
TEST(SessionRecognition, ACostFunctionIsCalledOnceWhereNothingMoves) {
  Tug tug;
  tug.Solve();
  const int before = tug.a.num_cost_only_calls;
  tug.Solve();
  EXPECT_EQ(tug.session.changes().num_kept_factors, 2);
  EXPECT_EQ(tug.a.num_cost_only_calls, before + 1);
}

TEST(SessionRecognition, OtherContentsAndOtherValuesAtOnce) {
  Tug tug;
  tug.b.weight = 1.0;
  tug.x = 100.0;
  tug.Solve();
  EXPECT_EQ(tug.session.changes().num_revalued_variables, 1);
  EXPECT_NEAR(tug.x, 2.5, 1e-6);
  EXPECT_NEAR(tug.session.summary.initial_cost, 0.5 * (99.0 * 99.0 + 96.0 * 96.0), 1e-6);
}

TEST(SessionRecognition, AnotherCostFunctionInARecycledResidualBlock) {
  Tug tug;
  Pull c(7.0, 2.0);
  tug.problem.RemoveResidualBlock(tug.first);
  // Whether or not the allocator hands the old block's address out again, the result is the same.
  tug.problem.AddResidualBlock(&c, nullptr, &tug.x);
  tug.Solve();
  EXPECT_EQ(tug.session.changes().num_kept_factors, 1);
  EXPECT_EQ(tug.session.changes().num_added_factors + tug.session.changes().num_replaced_factors,
            1);
  EXPECT_NEAR(tug.x, 5.5, 1e-6);
}

TEST(SessionRecognition, AZeroResidualProvesNothing) {
  ceres::Problem problem(Borrowing());
  Pull a(2.0, 1.0);
  Pull b(2.0, 2.0);
  double x = 2.0;  // both residuals are zero here, whatever the weights
  problem.AddResidualBlock(&a, nullptr, &x);
  problem.AddResidualBlock(&b, nullptr, &x);
  Session session;
  session.Solve(&problem);
  b.weight = 1.0;
  Pull c(5.0, 1.0);
  problem.AddResidualBlock(&c, nullptr, &x);
  session.Solve(&problem);
  EXPECT_EQ(session.changes().num_replaced_factors, 2);
  EXPECT_NEAR(x, 3.0, 1e-6);
}

TEST(SessionRecognition, AResidualThatDependsOnWhetherJacobiansAreAskedForProvesNothing) {
  Tug tug;
  tug.b.lies = true;
  tug.Solve();
  EXPECT_EQ(tug.session.changes().num_replaced_factors, 1) << "its cost-only residual has changed";
  tug.b.weight = 1.0;  // cost-only calls do not show it
  const int before = tug.b.num_jacobian_calls;
  tug.Solve();
  EXPECT_EQ(tug.session.changes().num_replaced_factors, 1);
  EXPECT_GT(tug.b.num_jacobian_calls, before);
}

TEST(SessionRecognition, WithoutVerificationOnlyAddressesCount) {
  Tug tug(/*verify=*/false);
  const int before = tug.b.num_cost_only_calls;
  tug.Solve();
  EXPECT_EQ(tug.b.num_cost_only_calls, before);
  tug.b.weight = 1.0;
  tug.Solve();
  EXPECT_EQ(tug.session.changes().num_kept_factors, 2);
  tug.session.session.Forget(&tug.b);
  tug.Solve();
  EXPECT_EQ(tug.session.changes().num_replaced_factors, 1);
  EXPECT_NEAR(tug.x, 2.5, 1e-6);
}

// r = x − target, of a size that changes between Remove and Add, as OKVIS's marginalization error
// does.
class Resizing : public ceres::CostFunction {
 public:
  explicit Resizing(int size) { Resize(size); }
  void Resize(int size) {
    set_num_residuals(size);
    mutable_parameter_block_sizes()->assign(1, 1);
  }
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    for (int i = 0; i < num_residuals(); ++i) {
      residuals[i] = parameters[0][0] - i;
      if (jacobians != nullptr && jacobians[0] != nullptr) {
        jacobians[0][i] = 1.0;
      }
    }
    return true;
  }
};

TEST(SessionRecognition, ACostFunctionThatHasGrown) {
  ceres::Problem problem(Borrowing());
  Resizing cost(2);
  double x = 9.0;
  ceres::ResidualBlockId id = problem.AddResidualBlock(&cost, nullptr, &x);
  Session session;
  session.Solve(&problem);
  EXPECT_NEAR(x, 0.5, 1e-6);
  problem.RemoveResidualBlock(id);
  cost.Resize(5);
  problem.AddResidualBlock(&cost, nullptr, &x);
  session.Solve(&problem);
  EXPECT_NEAR(x, 2.0, 1e-6);
  EXPECT_EQ(session.changes().num_added_factors, 1);
  EXPECT_EQ(session.changes().num_removed_factors, 1);
}

// Parameter blocks.

TEST(SessionRecognition, TheSameMemoryForAnotherVariable) {
  ceres::Problem problem(Borrowing());
  std::vector<double> memory = {0.0, 0.0, 0.0};
  auto* pair = new testing::TargetCost({1.0, 2.0});
  problem.AddResidualBlock(pair, nullptr, memory.data());
  Session session;
  session.Solve(&problem);
  EXPECT_NEAR(memory[1], 2.0, 1e-6);
  problem.RemoveParameterBlock(memory.data());
  delete pair;
  auto* triple = new testing::TargetCost({4.0, 5.0, 6.0});
  problem.AddResidualBlock(triple, nullptr, memory.data());
  session.Solve(&problem);
  EXPECT_EQ(session.changes().num_removed_variables, 1);
  EXPECT_EQ(session.changes().num_added_variables, 1);
  EXPECT_NEAR(memory[2], 6.0, 1e-6);
  delete triple;
}

TEST(SessionRecognition, ValuesThatTheCallerHasChanged) {
  Tug tug;
  tug.x = std::nextafter(tug.x, 10.0);
  tug.Solve();
  EXPECT_EQ(tug.session.changes().num_revalued_variables, 1);
  tug.x = -50.0;
  tug.Solve();
  EXPECT_EQ(tug.session.changes().num_revalued_variables, 1);
  EXPECT_NEAR(tug.x, 3.4, 1e-6);
  EXPECT_NEAR(tug.session.summary.initial_cost, 0.5 * (51.0 * 51.0 + 108.0 * 108.0), 1e-6);
}

TEST(SessionRecognition, ResidualBlocksOfConstantsAloneLeaveTheGraph) {
  ceres::Problem problem(Borrowing());
  double x = 0.0;
  double y = 0.0;
  Pull a(1.0, 1.0);
  Pull b(2.0, 1.0);
  problem.AddResidualBlock(&a, nullptr, &x);
  problem.AddResidualBlock(&b, nullptr, &y);
  Session session;
  session.Solve(&problem);
  x = 5.0;
  problem.SetParameterBlockConstant(&x);
  y = 6.0;
  session.Solve(&problem);
  EXPECT_EQ(session.changes().num_toggled_constants, 1);
  EXPECT_EQ(session.changes().num_removed_factors, 1);
  EXPECT_EQ(x, 5.0);
  EXPECT_NEAR(y, 2.0, 1e-6);
  EXPECT_NEAR(session.summary.fixed_cost, 8.0, 1e-12);
  EXPECT_NEAR(session.summary.initial_cost, 8.0 + 8.0, 1e-9);
  EXPECT_NEAR(session.summary.final_cost, 8.0, 1e-9);
  problem.SetParameterBlockVariable(&x);
  session.Solve(&problem);
  EXPECT_EQ(session.changes().num_added_factors, 1);
  EXPECT_NEAR(x, 1.0, 1e-6);
}

// Its last digit is more than all that can move, and so would be the tolerance.
TEST(SessionRecognition, AHugeFixedCostHidesNothing) {
  ceres::Problem problem(Borrowing());
  std::deque<Pull> pulls;
  std::array<double, 20> fixed{};
  for (std::size_t k = 0; k < fixed.size(); ++k) {
    pulls.emplace_back(1e8 + 0.1 * static_cast<double>(k * k), 1.0);
    problem.AddResidualBlock(&pulls.back(), nullptr, &fixed[k]);
  }
  double y = 0.0;
  Pull moving(2.0, 1.0);
  problem.AddResidualBlock(&moving, nullptr, &y);
  Session session;
  session.Solve(&problem);
  for (double& x : fixed) {
    x = 0.0;
    problem.SetParameterBlockConstant(&x);
  }
  ceres::Solver::Options options;
  options.logging_type = ceres::SILENT;
  for (const double start : {40.0, 2.001, 77.7, 1.999, 1234.5, 2.0001}) {
    y = start;
    session.session.Solve(options, &problem, &session.summary);
    EXPECT_EQ(session.summary.termination_type, ceres::CONVERGENCE);
    EXPECT_NEAR(y, 2.0, 1e-8);
    EXPECT_EQ(session.summary.fixed_cost, session.summary.final_cost);
  }
}

TEST(SessionRecognition, ACostThatWasNeverVariableCountsAsFixed) {
  ceres::Problem problem(Borrowing());
  double x = 0.0;
  double y = 0.0;
  Pull a(1.0, 1.0);
  Pull b(2.0, 1.0);
  problem.AddResidualBlock(&a, nullptr, &x);
  problem.AddResidualBlock(&b, nullptr, &y);
  problem.SetParameterBlockConstant(&x);
  Session session;
  session.Solve(&problem);
  EXPECT_EQ(session.changes().num_added_factors, 1);
  EXPECT_NEAR(session.summary.fixed_cost, 0.5, 1e-12);
  EXPECT_NEAR(session.summary.initial_cost, 2.5, 1e-12);
  EXPECT_NEAR(session.summary.final_cost, 0.5, 1e-9);
  problem.SetParameterBlockConstant(&y);
  session.Solve(&problem);
  EXPECT_EQ(session.summary.termination_type, ceres::CONVERGENCE) << "nothing to solve";
  EXPECT_NEAR(session.summary.final_cost, 0.5, 1e-9);
  problem.SetParameterBlockVariable(&y);
  problem.SetParameterBlockVariable(&x);
  session.Solve(&problem);
  EXPECT_NEAR(x, 1.0, 1e-6);
}

// Moves in the plane along one direction only, which the test can turn.
class Direction : public manifolds::Manifold {
 public:
  int AmbientSize() const override { return 2; }
  int TangentSize() const override { return 1; }
  bool Plus(const double* x, const double* delta, double* sum) const override {
    sum[0] = x[0] + std::cos(angle) * delta[0];
    sum[1] = x[1] + std::sin(angle) * delta[0];
    return true;
  }
  bool PlusJacobian(const double*, double* jacobian) const override {
    jacobian[0] = std::cos(angle);
    jacobian[1] = std::sin(angle);
    return true;
  }
  bool Minus(const double*, const double*, double*) const override { return false; }
  bool MinusJacobian(const double*, double*) const override { return false; }

  double angle = 0.0;
};

TEST(SessionRecognition, TheSameManifoldWithOtherContents) {
  ceres::Problem problem(Borrowing());
  Direction direction;
  testing::TargetCost cost({3.0, 4.0});
  std::vector<double> x = {0.0, 0.0};
  problem.AddParameterBlock(x.data(), 2, &direction);
  problem.AddResidualBlock(&cost, nullptr, x.data());
  Session session;
  session.Solve(&problem);
  EXPECT_NEAR(x[0], 3.0, 1e-6);
  EXPECT_EQ(x[1], 0.0);
  session.Solve(&problem);
  EXPECT_EQ(session.changes().num_kept_factors, 1);
  direction.angle = std::acos(0.0);
  session.Solve(&problem);
  EXPECT_EQ(session.changes().num_removed_variables, 1);
  EXPECT_NEAR(x[0], 3.0, 1e-6);
  EXPECT_NEAR(x[1], 4.0, 1e-6);
}

// A cost function that is revised while its block is moved is another one from then on, even where
// the solve ends at a residual of zero, or where the one before it has ended.
TEST(SessionRecognition, WhatIsRevisedWhileItsBlockIsMovedIsNotTakenForWhatItWas) {
  for (const bool ends_at_zero : {true, false}) {
    ceres::Problem problem(Borrowing());
    Pull a(1.0, 1.0), b(0.0, 1.0);
    double x = 3.0;
    problem.AddResidualBlock(&a, nullptr, &x);
    problem.AddResidualBlock(&b, nullptr, &x);
    Session session;
    session.Solve(&problem);
    EXPECT_NEAR(x, 0.5, 1e-6);
    x = ends_at_zero ? 0.0 : 3.0;
    a.target = ends_at_zero ? 0.0 : 1.0;
    a.weight = b.weight = ends_at_zero ? 1.0 : 2.0;
    session.Solve(&problem);
    EXPECT_NEAR(x, ends_at_zero ? 0.0 : 0.5, 1e-6);
    a.target = a.weight = b.weight = 1.0;
    session.Solve(&problem);
    EXPECT_NEAR(x, 0.5, 1e-6);
    EXPECT_NEAR(session.summary.final_cost, 0.25, 1e-6);
  }
}

// What a callback has made of a cost function is another function than the solver has linearized,
// though it is the same after the solve as before the next.
TEST(SessionRecognition, WhatIsRevisedWithinASolveIsNotTakenForWhatItWas) {
  ceres::Problem problem(Borrowing());
  Pull a(1.0, 1.0), b(0.0, 1.0), c(5.0, 1.0);
  double x = 3.0;
  problem.AddResidualBlock(&a, nullptr, &x);
  problem.AddResidualBlock(&b, nullptr, &x);
  Session session;
  session.Solve(&problem);
  EXPECT_NEAR(x, 0.5, 1e-6);
  problem.AddResidualBlock(&c, nullptr, &x);
  lambdas::Callback revise([&](const ceres::IterationSummary& iteration) {
    if (iteration.iteration == 0) {
      return ceres::SOLVER_CONTINUE;
    }
    b.weight = 0.1;
    return ceres::SOLVER_TERMINATE_SUCCESSFULLY;
  });
  ceres::Solver::Options options;
  options.callbacks = {&revise};
  session.Solve(&problem, options);
  EXPECT_NEAR(x, 2.0, 1e-3) << "one damped step";
  session.Solve(&problem);
  EXPECT_NEAR(x, 6.0 / 2.01, 1e-6);
  EXPECT_EQ(session.changes().num_replaced_factors, 1);
  EXPECT_NEAR(session.summary.initial_cost, 0.5 * (1.0 + 0.04 + 9.0), 1e-3);
}

TEST(SessionRecognition, AFixedResidualBlockThatFailsIsNamedAsByCeres) {
  ceres::Problem problem(Borrowing());
  Pull a(1.0, 1.0), fixed(0.0, 1.0);
  fixed.fails = true;
  double x = 3.0, y = 1.0;
  problem.AddResidualBlock(&a, nullptr, &x);
  problem.AddResidualBlock(&fixed, nullptr, &y);
  problem.SetParameterBlockConstant(&y);
  Session session;
  session.Solve(&problem);
  EXPECT_EQ(session.summary.termination_type, ceres::FAILURE);
  EXPECT_NE(session.summary.message.find("removal of fixed residual blocks"), std::string::npos)
      << session.summary.message;
  EXPECT_EQ(session.summary.num_parameter_blocks_reduced, -1);
  EXPECT_EQ(x, 3.0);
}

// Losses.

TEST(SessionRecognition, TheSameLossWithOtherContentsAndAnotherLoss) {
  ceres::Problem problem(Borrowing());
  ceres::LossFunctionWrapper loss(new ceres::HuberLoss(0.1), ceres::TAKE_OWNERSHIP);
  Pull a(0.0, 1.0);
  Pull b(10.0, 1.0);
  double x = 1.0;
  problem.AddResidualBlock(&a, nullptr, &x);
  const ceres::ResidualBlockId id = problem.AddResidualBlock(&b, &loss, &x);
  Session session;
  session.Solve(&problem);
  EXPECT_NEAR(x, 0.1, 1e-5);
  session.Solve(&problem);
  EXPECT_EQ(session.changes().num_changed_losses, 0);
  loss.Reset(new ceres::HuberLoss(0.3), ceres::TAKE_OWNERSHIP);
  session.Solve(&problem);
  EXPECT_EQ(session.changes().num_changed_losses, 1);
  EXPECT_NEAR(x, 0.3, 1e-5);
  problem.RemoveResidualBlock(id);
  problem.AddResidualBlock(&b, nullptr, &x);
  session.Solve(&problem);
  EXPECT_NEAR(x, 5.0, 1e-5);
}

TEST(SessionRecognition, AForgottenLossIsTakenUpAnew) {
  ceres::Problem problem(Borrowing());
  ceres::HuberLoss loss(1.0);
  Pull a(0.0, 1.0);
  double x = 1.0;
  problem.AddResidualBlock(&a, &loss, &x);
  Pull b(0.5, 1.0);
  problem.AddResidualBlock(&b, nullptr, &x);
  Session session;
  session.Solve(&problem);
  session.session.Forget(&loss);
  session.Solve(&problem);
  EXPECT_EQ(session.changes().num_changed_losses, 1);
}

}  // namespace
}  // namespace inceres
