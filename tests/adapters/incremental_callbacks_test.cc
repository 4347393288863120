// Callbacks and the work budget in a solve of incremental mode that the batch solver finishes: for
// the user it is one.
#include <stdexcept>
#include <string>

#include <gtest/gtest.h>

#include "adapters/callbacks_bench.h"

namespace inceres {
namespace {

using testing::CallbacksBench;
using testing::CostOf;
using testing::Recorder;
using testing::Way;

// Powell's function down to the last digit: more iterations than incremental steps are given.
struct Endless {
  explicit Endless(
      const SessionOptions& session_options = CallbacksBench::OptionsFor(Way::kIncremental))
      : session(session_options) {
    options.logging_type = ceres::SILENT;
    options.max_num_iterations = 200;
    options.function_tolerance = 0.0;
    start = test->blocks;
  }

  const ceres::Solver::Summary& Solve() {
    SolveOptions strict;
    strict.strict = true;
    session.Solve(options, &test->problem, &summary, strict, &report);
    return summary;
  }

  std::unique_ptr<testing::TestProblem> test = testing::MakePowell();
  ceres::Solver::Options options;
  CeresSession session;
  SolveReport report;
  ceres::Solver::Summary summary;
  std::deque<std::vector<double>> start;
};

// Incremental steps that end without convergence are finished by the batch solver: for the user
// that is one solve.
TEST(IncrementalCallbacks, SeeASolveOfTwoPartsAsOne) {
  Endless bench;
  Recorder recorder(bench.test.get());
  bench.options.callbacks = {&recorder};
  const ceres::Solver::Summary& summary = bench.Solve();
  EXPECT_NE(bench.report.exact_reason.find("are the batch solver's"), std::string::npos)
      << bench.report.exact_reason;
  EXPECT_EQ(summary.num_successful_steps + summary.num_unsuccessful_steps,
            static_cast<int>(summary.iterations.size()));
  ASSERT_EQ(recorder.iterations.size(), summary.iterations.size());
  for (std::size_t i = 0; i < summary.iterations.size(); ++i) {
    EXPECT_EQ(summary.iterations[i].iteration, static_cast<int>(i));
    EXPECT_EQ(recorder.iterations[i].iteration, static_cast<int>(i));
    EXPECT_EQ(recorder.iterations[i].cost, summary.iterations[i].cost);
    EXPECT_EQ(recorder.memory[i], bench.start) << i;
  }
  EXPECT_EQ(summary.iterations.front().cost, summary.initial_cost);
  EXPECT_NEAR(CostOf(bench.test.get()), summary.final_cost, 1e-9 * summary.final_cost);
}

// The budget is spent in the part that begins from the start again: nothing follows it.
TEST(IncrementalCallbacks, TheWorkBudgetEndsASolveBetweenItsParts) {
  Endless whole;
  whole.Solve();
  const std::int64_t all =
      whole.report.update.num_evaluated_factors + whole.report.update.num_relinearized_factors;
  for (std::int64_t budget = all / 20; budget < all; budget += all / 20) {
    SCOPED_TRACE(budget);
    SessionOptions session_options = CallbacksBench::OptionsFor(Way::kIncremental);
    session_options.core.max_factor_evaluations = budget;
    Endless bench(session_options);
    const ceres::Solver::Summary& summary = bench.Solve();
    EXPECT_EQ(summary.termination_type, ceres::NO_CONVERGENCE) << summary.message;
    EXPECT_NEAR(CostOf(bench.test.get()), summary.final_cost, 1e-9 * summary.final_cost);
  }
}

// A user's word ends the solve in its second part as in its first: with the values he saw, or with
// those of the start.
TEST(IncrementalCallbacks, EndASolveInItsSecondPart) {
  Endless whole;
  const std::string reason = (whole.Solve(), whole.report.exact_reason);
  const int first_part = std::stoi(reason.substr(reason.find("iteration ") + 10));
  for (const bool update : {false, true}) {
    for (const auto end : {ceres::SOLVER_ABORT, ceres::SOLVER_TERMINATE_SUCCESSFULLY}) {
      Endless bench;
      Recorder recorder(bench.test.get(), first_part + 1, end);
      bench.options.update_state_every_iteration = update;
      bench.options.callbacks = {&recorder};
      const ceres::Solver::Summary& summary = bench.Solve();
      EXPECT_EQ(summary.termination_type,
                end == ceres::SOLVER_ABORT ? ceres::USER_FAILURE : ceres::USER_SUCCESS);
      EXPECT_EQ(recorder.iterations.size(), static_cast<std::size_t>(first_part) + 2);
      EXPECT_EQ(bench.test->blocks == bench.start, end == ceres::SOLVER_ABORT);
    }
  }
  Endless bench;
  lambdas::Callback thrower([=](const ceres::IterationSummary& row) {
    return row.iteration > first_part ? throw std::runtime_error("enough") : ceres::SOLVER_CONTINUE;
  });
  bench.options.callbacks = {&thrower};
  EXPECT_THROW(bench.Solve(), std::runtime_error);
  EXPECT_EQ(bench.test->blocks, bench.start);
}

TEST(IncrementalCallbacks, TheWorkBudgetEndsAllParts) {
  for (const std::int64_t budget : {1, 900, 1500}) {
    SCOPED_TRACE(budget);
    SessionOptions session_options = CallbacksBench::OptionsFor(Way::kIncremental);
    session_options.core.max_factor_evaluations = budget;
    CallbacksBench bench(Way::kIncremental, session_options);
    EXPECT_EQ(bench.Solve().termination_type, ceres::NO_CONVERGENCE);
    EXPECT_EQ(bench.report.exact_reason, "");
    EXPECT_NEAR(CostOf(bench.test.get()), bench.summary.final_cost,
                1e-9 * bench.summary.final_cost);
  }
}

}  // namespace
}  // namespace inceres
