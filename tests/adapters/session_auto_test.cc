// What a session that chooses by itself does while little of a problem is remembered.
#include <string>

#include <gtest/gtest.h>

#include "adapters/incremental_window.h"
#include "adapters/session_support.h"
#include "inceres/ceres/session.h"
#include "inceres/ceres/solve.h"

namespace inceres {
namespace {

using testing::IncrementalWindow;

// Too large for a window, for all it knows.
SessionOptions Automatic() {
  SessionOptions options = testing::AlwaysIncremental();
  options.automatic = true;
  return options;
}

ceres::Solver::Options Options() {
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.max_num_iterations = 100;
  options.logging_type = ceres::SILENT;
  return options;
}

// The window, and its twin for an exact solve of the same problem.
class SessionAuto : public ::testing::Test {
 protected:
  void Step() {
    ours_.Step();
    twin_.Step();
  }
  void Solve(const ceres::Solver::Options& options = Options()) {
    twin_.SetValues(ours_.Values());
    SolveOptions strict;
    strict.strict = true;
    report_ = SolveReport();
    session_.Solve(options, ours_.problem(), &summary_, strict, &report_);
    strict.mode = SolveMode::kExact;
    inceres::Solve(options, twin_.problem(), &exact_, strict);
  }
  bool IsExact() const { return !report_.exact_reason.empty(); }
  void ExpectTheExactSolve(const std::string& where) const {
    EXPECT_NE(report_.exact_reason.find("remembered"), std::string::npos) << report_.exact_reason;
    EXPECT_EQ(summary_.message, exact_.message) << where;
    ASSERT_EQ(summary_.iterations.size(), exact_.iterations.size()) << where;
    for (std::size_t i = 0; i < exact_.iterations.size(); ++i) {
      EXPECT_EQ(summary_.iterations[i].cost, exact_.iterations[i].cost) << where << ", " << i;
      EXPECT_EQ(summary_.iterations[i].trust_region_radius,
                exact_.iterations[i].trust_region_radius)
          << where << ", " << i;
    }
  }

  IncrementalWindow ours_;
  IncrementalWindow twin_;
  CeresSession session_{Automatic()};
  ceres::Solver::Summary summary_;
  ceres::Solver::Summary exact_;
  SolveReport report_;
};

TEST_F(SessionAuto, WhatIsNotRememberedIsSolvedAsInExactModeToTheEnd) {
  Step();
  for (int step = 1; step < 20; ++step) {
    Step();
    Solve();
    const std::string where = "step " + std::to_string(step);
    if (step <= 2) {
      ExpectTheExactSolve(where);
      EXPECT_EQ(ours_.Values(), twin_.Values()) << where;
    } else {
      EXPECT_FALSE(IsExact()) << where << ": " << report_.exact_reason;
      EXPECT_GT(report_.changes.num_kept_factors, report_.changes.num_added_factors) << where;
      EXPECT_EQ(report_.update.num_batch_iterations, 0) << where;
      EXPECT_LE(summary_.final_cost, (1.0 + 1e-6) * exact_.final_cost) << where;
    }
  }
}

// Exact solves that do not come to an end may do no better in incremental steps: that is found out
// once two in a row have changed little.
TEST_F(SessionAuto, SlowSolvesAreRememberedLater) {
  Step();
  ceres::Solver::Options few = Options();
  few.max_num_iterations = 1;
  few.function_tolerance = 1e-15;
  for (int step = 1; step < 4; ++step) {
    Step();
    Solve(few);
    ExpectTheExactSolve("step " + std::to_string(step));
  }
  Step();
  Solve(few);
  EXPECT_GT(report_.changes.num_kept_factors, report_.changes.num_added_factors);
}

// A few frames are remembered, and as many and more come at once.
TEST_F(SessionAuto, WhereMostIsNewWhatIsRememberedIsOfNoUse) {
  Step();
  for (int step = 1; step < 4; ++step) {
    Step();
    Solve();
  }
  EXPECT_FALSE(IsExact()) << report_.exact_reason;
  for (int step = 4; step < IncrementalWindow::kMaxFrames; ++step) {
    Step();
  }
  Solve();
  ExpectTheExactSolve("many frames at once");
  EXPECT_EQ(ours_.Values(), twin_.Values());
}

}  // namespace
}  // namespace inceres
