// What a session that chooses by itself does while little of a problem is remembered.
#include <algorithm>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "adapters/captured_log.h"
#include "adapters/incremental_window.h"
#include "adapters/session_support.h"
#include "inceres/ceres/session.h"
#include "inceres/ceres/solve.h"
#include "support/ceres_lambdas.h"

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

// r = w x⁴, of which a step leaves three quarters of x: nobody comes to an end in 30 iterations. As
// incremental steps are given up after 25, and the batch solver goes on, they take the more work.
class SlowDescent {
 public:
  explicit SlowDescent(const SessionOptions& options) : session_(options) {
    for (lambdas::Formula* cost : {&light_, &heavy_}) {
      problem_.AddResidualBlock(cost, nullptr, &x_);
    }
  }
  // From the same start each time. Returns whether all of it was exact.
  bool Solve() {
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
    options.max_num_iterations = 30;
    options.function_tolerance = 1e-16;
    options.gradient_tolerance = 0.0;
    options.logging_type = ceres::SILENT;
    x_ = 1.0;
    ceres::Solver::Summary summary;
    SolveReport report;
    session_.Solve(options, &problem_, &summary, {}, &report);
    EXPECT_TRUE(summary.IsSolutionUsable()) << summary.message;
    const bool is_exact = report.exact_reason.rfind("auto: ", 0) == 0;
    // Of all parts of the solve.
    EXPECT_EQ(report.update.num_iterations, is_exact ? 0 : options.max_num_iterations);
    return is_exact;
  }

 private:
  static lambdas::Formula Quartic(double weight) {
    return {1, {1}, [weight](double const* const* x, double* residuals, double** jacobians) {
              const double cube = x[0][0] * x[0][0] * x[0][0];
              residuals[0] = weight * cube * x[0][0];
              jacobians[0][0] = 4.0 * weight * cube;
              return true;
            }};
  }

  lambdas::Formula light_ = Quartic(1.0);
  lambdas::Formula heavy_ = Quartic(2.0);
  double x_ = 1.0;
  ceres::Problem problem_{testing::Borrowing()};
  CeresSession session_;
};

bool HasSaid(const testing::CapturedLog& log, const std::string& words) {
  const std::vector<std::string> messages = log.messages();
  return std::any_of(messages.begin(), messages.end(), [&words](const std::string& message) {
    return message.find(words) != std::string::npos;
  });
}

// As many as it says, and it says when they are over, not before.
TEST(SessionChoice, SolvesAreExactAsLongAsTheLogSays) {
  SlowDescent descent(Automatic());
  const testing::CapturedLog log(google::GLOG_INFO);
  for (int k = 0; !HasSaid(log, "the next 4 solves of this problem are exact"); ++k) {
    ASSERT_LT(k, 10);
    descent.Solve();
  }
  for (int k = 0; k < 4; ++k) {
    EXPECT_TRUE(descent.Solve()) << k;
    EXPECT_FALSE(HasSaid(log, "incremental again")) << k;
  }
  EXPECT_FALSE(descent.Solve());
  EXPECT_TRUE(HasSaid(log, "incremental again"));
  // One that loses is enough for a longer pause.
  EXPECT_TRUE(HasSaid(log, "the next 8 solves of this problem are exact"));
}

TEST(SessionChoice, ASessionThatChoosesNothingTellsOfNoChoice) {
  SlowDescent descent(testing::AlwaysIncremental());
  const testing::CapturedLog log(google::GLOG_INFO);
  for (int k = 0; k < 10; ++k) {
    EXPECT_FALSE(descent.Solve());
  }
  EXPECT_FALSE(HasSaid(log, "auto:"));
}

}  // namespace
}  // namespace inceres
