// A user's own solver of the reduced system, as an IncrementalSolver calls it.

#include <gtest/gtest.h>

#include "incremental/incremental_bundle.h"
#include "linear/counting_solver.h"

namespace inceres {
namespace {

using test::CountingSolver;
using test::IncrementalBundle;
using test::MakesCountingSolvers;

IncrementalOptions OptionsWith(const ReducedSolverFactory& factory) {
  IncrementalOptions options;
  options.function_tolerance = 1e-9;
  options.max_num_iterations = 200;
  options.batch_share = 1.0;
  options.reduced_solver_factory = factory;
  return options;
}

TEST(IncrementalReducedSolverFactory, ServesTheBatchSolverToo) {
  CountingSolver::Record calls;
  IncrementalOptions options = OptionsWith(MakesCountingSolvers(&calls));
  options.batch_share = 0.0;
  IncrementalBundle bundle(options, 11);
  bundle.Grow(4, 25, 3);
  EXPECT_EQ(bundle.solver.Update().termination, Termination::kConvergence);
  EXPECT_EQ(calls.num_made, 1);
}

// Of a new pattern once, and of the rows that have changed: here those of a frame whose prior comes
// and goes.
TEST(IncrementalReducedSolverFactory, IsToldWhatHasChanged) {
  CountingSolver::Record calls;
  IncrementalBundle bundle(OptionsWith(MakesCountingSolvers(&calls)), 11);
  bundle.Grow(12, 60, 3);
  EXPECT_EQ(bundle.solver.Update().termination, Termination::kConvergence);
  EXPECT_EQ(calls.num_analyses, 1);
  EXPECT_GT(calls.num_factorizations, 1);
  const FactorId prior = bundle.AddPrior(bundle.frames()[0], 1e-3);
  bundle.Apply();
  EXPECT_EQ(bundle.solver.Update().termination, Termination::kConvergence);
  bundle.RemoveFactor(prior);
  bundle.Apply();
  const int before = calls.num_factorizations;
  EXPECT_EQ(bundle.solver.Update().termination, Termination::kConvergence);
  EXPECT_GT(calls.num_factorizations, before);
  EXPECT_EQ(calls.num_analyses, 1);
  EXPECT_LT(calls.num_changed_rows, 12);
  EXPECT_EQ(calls.num_made, 1);
}

// Broken for good, which more damping would not mend.
TEST(IncrementalReducedSolverFactory, WhatIsNotSingularEndsTheUpdateAndTheStateIsKept) {
  CountingSolver::Record broken;
  broken.factorization = Status::Error(StatusCode::kUnavailable, "no device");
  IncrementalBundle bundle(OptionsWith(MakesCountingSolvers(&broken)), 11);
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
