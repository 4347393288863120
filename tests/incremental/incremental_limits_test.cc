// An Update may be cut short at any time: it ends with the best state so far, and a later one goes
// on.

#include <atomic>
#include <chrono>
#include <functional>
#include <thread>

#include <gtest/gtest.h>

#include "incremental/incremental_bundle.h"
#include "incremental/incremental_function.h"

namespace inceres {
namespace {

using test::IncrementalBundle;
using test::IncrementalFunction;

IncrementalOptions WithoutBatch() {
  IncrementalOptions options;
  options.function_tolerance = 1e-9;
  options.batch_share = 1.0;
  return options;
}

// What is cut short never costs more than where it began, and in the end the minimum is that of an
// Update without limits.
void ExpectAnytime(const IncrementalOptions& options, int most_updates) {
  IncrementalBundle free(WithoutBatch(), 10);
  free.Grow(10, 60, 3);
  const double minimum = free.solver.Update().final_cost;

  IncrementalBundle bundle(options, 10);
  bundle.Grow(10, 60, 3);
  double cost = 0.0;
  for (int update = 0; update < most_updates; ++update) {
    const UpdateSummary summary = bundle.solver.Update();
    ASSERT_NE(summary.termination, Termination::kFailure) << summary.message;
    ASSERT_LE(summary.final_cost, summary.initial_cost);
    if (update > 0) {
      ASSERT_NEAR(summary.initial_cost, cost, 1e-12 * cost) << "it goes on where it stopped";
    }
    cost = summary.final_cost;
    if (summary.termination == Termination::kConvergence) {
      EXPECT_GT(update, 0) << "the limit was no limit";
      EXPECT_NEAR(cost, minimum, 1e-6 * minimum);
      return;
    }
    EXPECT_NE(summary.message.find("limit"), std::string::npos) << summary.message;
  }
  ADD_FAILURE() << "not converged after " << most_updates << " updates";
}

TEST(IncrementalLimits, Iterations) {
  IncrementalOptions options = WithoutBatch();
  options.max_num_iterations = 2;
  ExpectAnytime(options, 50);
}

TEST(IncrementalLimits, FactorEvaluations) {
  IncrementalOptions options = WithoutBatch();
  options.max_factor_evaluations = 400;
  ExpectAnytime(options, 100);
}

TEST(IncrementalLimits, FactorEvaluationsAreOverdrawnByOneIterationAtMost) {
  IncrementalOptions options = WithoutBatch();
  options.max_factor_evaluations = 1;
  IncrementalBundle bundle(options, 10);
  bundle.Grow(10, 60, 3);
  const UpdateSummary summary = bundle.solver.Update();
  EXPECT_EQ(summary.termination, Termination::kNoConvergence);
  EXPECT_EQ(summary.num_relinearized_factors, bundle.num_factors())
      << "without a linearization there is no cost";
  EXPECT_EQ(summary.num_iterations, 0);
  EXPECT_EQ(summary.final_cost, summary.initial_cost);
}

TEST(IncrementalLimits, FactorEvaluationsOfTheBatchSolverCountToo) {
  IncrementalOptions options;
  options.function_tolerance = 1e-12;
  IncrementalBundle bundle(options, 10);
  bundle.Grow(10, 60, 3);
  const UpdateSummary free = bundle.solver.Update();
  ASSERT_GT(free.num_batch_iterations, 2);

  options.max_factor_evaluations = 3 * bundle.num_factors();
  IncrementalBundle limited(options, 10);
  limited.Grow(10, 60, 3);
  const UpdateSummary summary = limited.solver.Update();
  EXPECT_EQ(summary.termination, Termination::kNoConvergence);
  EXPECT_LT(summary.num_evaluated_factors + summary.num_relinearized_factors,
            8 * bundle.num_factors());
}

TEST(IncrementalLimits, Seconds) {
  IncrementalOptions options = WithoutBatch();
  options.max_solver_time_in_seconds = 1e-9;
  IncrementalBundle bundle(options, 10);
  bundle.Grow(10, 60, 3);
  const UpdateSummary summary = bundle.solver.Update();
  EXPECT_EQ(summary.termination, Termination::kNoConvergence);
  EXPECT_EQ(summary.final_cost, summary.initial_cost);
  EXPECT_EQ(summary.num_iterations, 0);
}

TEST(IncrementalLimits, AStopAskedForBeforeAnUpdateEndsThatOneOnly) {
  for (const double batch_share : {0.5, 1.0}) {
    IncrementalOptions options = WithoutBatch();
    options.batch_share = batch_share;
    IncrementalBundle bundle(options, 10);
    bundle.Grow(10, 60, 3);
    bundle.solver.RequestStop();
    const UpdateSummary stopped = bundle.solver.Update();
    EXPECT_EQ(stopped.termination, Termination::kNoConvergence) << stopped.message;
    EXPECT_LE(stopped.final_cost, stopped.initial_cost);
    EXPECT_LE(stopped.num_iterations, 1);
    const UpdateSummary next = bundle.solver.Update();
    EXPECT_EQ(next.termination, Termination::kConvergence) << next.message;
    EXPECT_LT(next.final_cost, stopped.final_cost);
  }
}

TEST(IncrementalLimits, AStopAskedForBeforeAnUpdateWithNothingToDoEndsThatOne) {
  IncrementalBundle bundle(WithoutBatch(), 10);
  bundle.Grow(10, 60, 3);
  ASSERT_EQ(bundle.solver.Update().termination, Termination::kConvergence);
  bundle.solver.RequestStop();
  EXPECT_EQ(bundle.solver.Update().termination, Termination::kConvergence);
  bundle.Grow(2, 10, 3);
  EXPECT_EQ(bundle.solver.Update().termination, Termination::kConvergence);
}

// One variable that creeps toward its minimum: every evaluation waits until the other thread has
// asked for the stop.
TEST(IncrementalLimits, AStopFromAnotherThreadEndsTheUpdateThatRuns) {
  std::atomic<bool> running{false};
  std::atomic<bool> asked{false};
  const auto slow = [&](double x) {
    running = true;
    while (!asked) {
      std::this_thread::yield();
    }
    return std::exp(x);
  };
  IncrementalOptions options = WithoutBatch();
  options.function_tolerance = 0.0;
  IncrementalFunction problem(options, test::ScalarFunction(slow, slow));
  ASSERT_TRUE(problem.applied);
  IncrementalSolver& solver = problem.solver;
  std::thread stopper([&] {
    while (!running) {
      std::this_thread::yield();
    }
    solver.RequestStop();
    asked = true;
  });
  const UpdateSummary summary = solver.Update();
  stopper.join();
  EXPECT_EQ(summary.termination, Termination::kNoConvergence);
  EXPECT_LE(summary.num_iterations, 1);
  EXPECT_LE(summary.final_cost, summary.initial_cost);
  const UpdateSummary next = solver.Update();
  EXPECT_GT(next.num_iterations, 5);
  EXPECT_LT(next.final_cost, summary.final_cost);
}

}  // namespace
}  // namespace inceres
