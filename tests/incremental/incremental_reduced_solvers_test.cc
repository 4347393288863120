// A user's own solver of the reduced system, as an IncrementalSolver calls it.

#include <gtest/gtest.h>

#include "inceres/problem/losses.h"
#include "incremental/incremental_bundle.h"
#include "linear/eigen_ldlt_solver.h"

namespace inceres {
namespace {

using test::IncrementalBundle;

IncrementalOptions OptionsWith(const ReducedSolverFactory& factory) {
  IncrementalOptions options;
  options.function_tolerance = 1e-9;
  options.max_num_iterations = 200;
  options.batch_share = 1.0;
  options.reduced_solver_factory = factory;
  return options;
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
