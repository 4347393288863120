// What a run of the window estimators makes of solves that fail.

#include <cmath>
#include <fstream>
#include <string>

#include <ceres/ceres.h>
#include <gtest/gtest.h>

#include "common/run.h"

namespace sliding_window {
namespace {

// An estimator that solves at every image, and says where it began.
AddFrame MakeStill(const EstimatorOptions& /*options*/, const SolveFunction& solve,
                   const ImuState& start, const std::vector<Pose>& /*body_from_cameras*/) {
  return [solve, start](const Frame& /*frame*/) {
    ceres::Problem problem;
    ceres::Solver::Summary summary;
    solve(ceres::Solver::Options(), &problem, &summary);
    return start;
  };
}

// Every third solve fails; a Summary without a solve is that of one.
RunReport RunWithFailures(const RunOptions& options, double cost) {
  int num_solves = 0;
  return Run(options, MakeStill,
             [&](const ceres::Solver::Options& /*solver*/, ceres::Problem* /*problem*/,
                 ceres::Solver::Summary* summary) {
               if (++num_solves % 3 != 0) {
                 summary->termination_type = ceres::CONVERGENCE;
                 summary->final_cost = cost;
               }
             });
}

TEST(SlidingWindowRun, SolvesThatFailAreCountedAndNoPartOfTheFigures) {
  RunOptions options;
  options.num_frames = 21;
  const RunReport report = RunWithFailures(options, 2.0);
  EXPECT_EQ(report.num_failed_solves, 7);
  EXPECT_EQ(report.solve_ms.size(), 14U);
  EXPECT_EQ(report.final_cost_sum, 28.0);
  EXPECT_FALSE(Write(options, report));
  RunReport without = report;
  without.num_failed_solves = 0;
  EXPECT_TRUE(Write(options, without));
}

TEST(SlidingWindowRun, WhatIsNotFiniteIsNull) {
  RunOptions options;
  options.num_frames = 21;
  options.json = ::testing::TempDir() + "sliding_window_run_test.json";
  EXPECT_FALSE(Write(options, RunWithFailures(options, NAN)));
  std::ifstream file(options.json);
  std::string text;
  std::getline(file, text);
  EXPECT_NE(text.find("\"final_cost_sum\": null}"), std::string::npos) << text;
  EXPECT_EQ(text.find("nan"), std::string::npos) << text;
}

}  // namespace
}  // namespace sliding_window
