// Whoever solves the reduced system, the minimum is the same; conjugate gradients included.

#include <gtest/gtest.h>

#include "inceres/problem/losses.h"
#include "incremental/incremental_bundle.h"
#include "linear/eigen_ldlt_solver.h"

namespace inceres {
namespace {

using test::IncrementalBundle;

class IncrementalReducedSolvers : public testing::TestWithParam<ReducedSolverKind> {};

TEST_P(IncrementalReducedSolvers, EndAtTheBatchMinimum) {
  IncrementalOptions options;
  options.function_tolerance = 1e-9;
  options.max_num_iterations = 200;
  options.batch_share = 1.0;
  options.reduced_solver = GetParam();
  IncrementalBundle bundle(options, 11);
  const auto expect_minimum = [&bundle](const char* when) {
    const UpdateSummary summary = bundle.solver.Update();
    EXPECT_EQ(summary.termination, Termination::kConvergence) << when << ": " << summary.message;
    const double minimum = bundle.SolveInBatch(true).final_cost;
    EXPECT_LE(summary.final_cost - minimum, 1e-6 * minimum) << when;
    EXPECT_EQ(summary.num_pcg_iterations > 0, GetParam() == ReducedSolverKind::kPcg) << when;
  };
  bundle.Grow(10, 60, 3);
  expect_minimum("at first");
  const FactorId pins[] = {bundle.AddPrior(bundle.frames()[0], 1e7),
                           bundle.AddPrior(bundle.frames()[5], 1e7)};
  bundle.Apply();
  expect_minimum("with priors of weight 1e14");
  bundle.Grow(4, 20, 3, std::make_shared<HuberLoss>(0.2));
  expect_minimum("grown beside them");
  bundle.SetConstant(bundle.frames()[2], true);
  bundle.RemoveFactor(pins[0]);
  bundle.Apply();
  expect_minimum("without one of them, a frame held");
  bundle.RemoveVariable(bundle.frames()[5]);
  bundle.Apply();
  expect_minimum("without a frame");
}

std::string NameOf(const testing::TestParamInfo<ReducedSolverKind>& info) {
  switch (info.param) {
    case ReducedSolverKind::kAutomatic:
      return "Automatic";
    case ReducedSolverKind::kResumed:
      return "Resumed";
    case ReducedSolverKind::kDense:
      return "Dense";
    case ReducedSolverKind::kSparse:
      return "Sparse";
    case ReducedSolverKind::kPcg:
      return "Pcg";
    case ReducedSolverKind::kAutomaticInexact:
      break;  // for batch solves
  }
  return "";
}

INSTANTIATE_TEST_SUITE_P(Kinds, IncrementalReducedSolvers,
                         testing::Values(ReducedSolverKind::kAutomatic, ReducedSolverKind::kResumed,
                                         ReducedSolverKind::kDense, ReducedSolverKind::kSparse,
                                         ReducedSolverKind::kPcg),
                         NameOf);

IncrementalOptions OptionsWith(const ReducedSolverFactory& factory) {
  IncrementalOptions options;
  options.function_tolerance = 1e-9;
  options.max_num_iterations = 200;
  options.batch_share = 1.0;
  options.reduced_solver_factory = factory;
  return options;
}

TEST(IncrementalReducedSolverFactory, EndsAtTheBatchMinimumAsEditsComeAndGo) {
  int num_made = 0;
  IncrementalBundle bundle(OptionsWith([&num_made] {
                             ++num_made;
                             return std::make_unique<EigenLdltSolver>();
                           }),
                           11);
  for (int round = 0; round < 3; ++round) {
    bundle.Grow(4, 25, 3);
    bundle.SetConstant(bundle.frames()[1], round == 1);
    bundle.Apply();
    const UpdateSummary summary = bundle.solver.Update();
    EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
    const double minimum = bundle.SolveInBatch(true).final_cost;
    EXPECT_LE(summary.final_cost - minimum, 1e-6 * minimum) << round;
  }
  EXPECT_EQ(num_made, 1);
}

TEST(IncrementalReducedSolverFactory, ServesTheBatchSolverToo) {
  int num_made = 0;
  IncrementalOptions options = OptionsWith([&num_made] {
    ++num_made;
    return std::make_unique<EigenLdltSolver>();
  });
  options.batch_share = 0.0;
  IncrementalBundle bundle(options, 11);
  bundle.Grow(4, 25, 3);
  EXPECT_EQ(bundle.solver.Update().termination, Termination::kConvergence);
  EXPECT_EQ(num_made, 1);
}

class CountingSolver final : public ReducedSolver {
 public:
  struct Calls {
    int analyses = 0, factorizations = 0, changed_rows = 0;
  };
  explicit CountingSolver(Calls* calls) : calls_(*calls) {}
  const char* Name() const override { return "counting"; }
  Status Analyze(const ReducedMatrix& A) override {
    ++calls_.analyses;
    return solver_.Analyze(A);
  }
  Status Factorize(const ReducedMatrix& A, const Rows& changed) override {
    ++calls_.factorizations;
    calls_.changed_rows =
        changed.rows != nullptr ? static_cast<int>(changed.rows->size()) : A.pattern().num_blocks();
    return solver_.Factorize(A, changed);
  }
  Status Solve(const double* b, const Rows& changed_b, const Truncation& truncation,
               double* x) override {
    return solver_.Solve(b, changed_b, truncation, x);
  }

 private:
  Calls& calls_;
  EigenLdltSolver solver_;
};

// Of a new pattern once, and of the rows that have changed: here those of a frame whose prior comes
// and goes.
TEST(IncrementalReducedSolverFactory, IsToldWhatHasChanged) {
  CountingSolver::Calls calls;
  IncrementalBundle bundle(
      OptionsWith([&calls] { return std::make_unique<CountingSolver>(&calls); }), 11);
  bundle.Grow(12, 60, 3);
  EXPECT_EQ(bundle.solver.Update().termination, Termination::kConvergence);
  EXPECT_EQ(calls.analyses, 1);
  EXPECT_GT(calls.factorizations, 1);
  const FactorId prior = bundle.AddPrior(bundle.frames()[0], 1e-3);
  bundle.Apply();
  EXPECT_EQ(bundle.solver.Update().termination, Termination::kConvergence);
  bundle.RemoveFactor(prior);
  bundle.Apply();
  const int before = calls.factorizations;
  EXPECT_EQ(bundle.solver.Update().termination, Termination::kConvergence);
  EXPECT_GT(calls.factorizations, before);
  EXPECT_EQ(calls.analyses, 1);
  EXPECT_LT(calls.changed_rows, 12);
}

// Broken for good, which more damping would not mend.
class BrokenSolver final : public ReducedSolver {
 public:
  const char* Name() const override { return "broken"; }
  Status Factorize(const ReducedMatrix& /*A*/, const Rows& /*changed*/) override {
    return Status::Error(StatusCode::kUnavailable, "no device");
  }
  Status Solve(const double* /*b*/, const Rows& /*changed*/, const Truncation& /*truncation*/,
               double* /*x*/) override {
    return Status::Ok();
  }
};

TEST(IncrementalReducedSolverFactory, WhatIsNotSingularEndsTheUpdateAndTheStateIsKept) {
  IncrementalBundle bundle(OptionsWith([] { return std::make_unique<BrokenSolver>(); }), 11);
  bundle.Grow(4, 25, 3);
  const std::vector<double> before = bundle.solver.graph().state();
  const UpdateSummary summary = bundle.solver.Update();
  EXPECT_EQ(summary.termination, Termination::kFailure);
  EXPECT_EQ(summary.message, "no device");
  EXPECT_EQ(summary.num_iterations, 1);
  EXPECT_EQ(bundle.solver.graph().state(), before);
}

TEST(IncrementalReducedSolverFactory, OneThatReturnsNullIsNamed) {
  IncrementalBundle bundle(OptionsWith([] { return std::unique_ptr<ReducedSolver>(); }), 11);
  bundle.Grow(4, 25, 3);
  const UpdateSummary summary = bundle.solver.Update();
  EXPECT_EQ(summary.termination, Termination::kFailure);
  EXPECT_EQ(summary.message, "IncrementalOptions::reduced_solver_factory returned null");
}

}  // namespace
}  // namespace inceres
