// docs/ceres_contract.md, "Reports": those that Ceres makes of a summary; their text is next to
// stock's in adapters/summary_test.cc.
#include <limits>

#include "conformance/support.h"

namespace conformance {
namespace {

TEST(Report33, IsSolutionUsable) {
  Line line;
  Options options = Small();
  EXPECT_TRUE(Solve(options, &line.problem).summary.IsSolutionUsable());
  options.max_num_iterations = 0;
  EXPECT_TRUE(Solve(options, &line.problem).summary.IsSolutionUsable());
  Callback abort([](const ceres::IterationSummary&) { return ceres::SOLVER_ABORT; });
  options.callbacks.push_back(&abort);
  EXPECT_FALSE(Solve(options, &line.problem).summary.IsSolutionUsable());
  line.x[0] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(Solve(options, &line.problem).summary.IsSolutionUsable());
}

// Invalid options: nothing but the message is written.
TEST(Report33, FullReportOfInvalidOptions) {
  Line line;
  Options options = Small();
  options.max_num_iterations = -1;
  const Outcome outcome = Solve(options, &line.problem);
  const std::string reason =
      "Invalid configuration. Solver::Options::max_num_iterations = -1. Violated constraint: "
      "Solver::Options::max_num_iterations >= 0";
  EXPECT_EQ(outcome.summary.message, reason);
  EXPECT_EQ(outcome.errors, std::vector<std::string>{"Terminating: " + reason});
  EXPECT_EQ(outcome.summary.termination_type, ceres::FAILURE);
  EXPECT_EQ(outcome.summary.num_parameter_blocks, -1);
  EXPECT_EQ(outcome.summary.initial_cost, -1.0);
  EXPECT_EQ(outcome.summary.final_cost, -1.0);
  EXPECT_EQ(outcome.summary.total_time_in_seconds, -1.0);
  EXPECT_EQ(outcome.summary.num_successful_steps, -1);
  EXPECT_EQ(line.x[0], 0.5);
}

// What a summary holds from before does not show.
TEST(Report33, SummariesAreResetFirst) {
  Line line;
  Summary summary = Solve(Small(), &line.problem).summary;
  Options options = Small();
  options.max_num_iterations = -1;
  ceres::Solve(options, &line.problem, &summary);
  EXPECT_TRUE(summary.iterations.empty());
  EXPECT_EQ(summary.num_jacobian_evaluations, -1);
}

}  // namespace
}  // namespace conformance
