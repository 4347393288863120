#pragma once

#include <gtest/gtest.h>

#include "adapters/session_support.h"
#include "adapters/test_problems.h"
#include "inceres/ceres/session.h"
#include "inceres/ceres/solve.h"

namespace inceres::testing {

/// The ways a solve with callbacks goes: in exact mode; as a session's, through the batch solver;
/// and not through it, on a problem solved before and then shaken.
enum class Way { kExact, kBatchFirst, kIncremental };

inline double CostOf(TestProblem* test) {
  double cost = -1.0;
  test->problem.Evaluate(ceres::Problem::EvaluateOptions(), &cost, nullptr, nullptr, nullptr);
  return cost;
}

/// A bundle about to be solved in one of these ways.
class CallbacksBench {
 public:
  explicit CallbacksBench(Way way) : CallbacksBench(way, OptionsFor(way)) {}
  CallbacksBench(Way way, const SessionOptions& session_options)
      : session(session_options), way_(way) {
    options.linear_solver_type = ceres::DENSE_SCHUR;
    options.logging_type = ceres::SILENT;
    options.max_num_iterations = 200;
    options.function_tolerance = 1e-9;
    if (way == Way::kIncremental) {
      Solve();
      for (std::size_t b = 1; b < test->blocks.size(); b += 3) {
        test->blocks[b][0] += 0.02;
        test->blocks[b][1] -= 0.01;
      }
    }
    start = test->blocks;
  }

  static SessionOptions OptionsFor(Way way) {
    SessionOptions session_options = AlwaysIncremental();
    session_options.core.batch_share = way == Way::kIncremental ? 1.0 : 0.5;
    return session_options;
  }

  const ceres::Solver::Summary& Solve() {
    SolveOptions strict;
    strict.strict = true;
    if (way_ == Way::kExact) {
      inceres::Solve(options, &test->problem, &summary, strict, &report);
    } else {
      session.Solve(options, &test->problem, &summary, strict, &report);
    }
    EXPECT_FALSE(report.used_stock) << report.fallback_reason;
    return summary;
  }

  std::unique_ptr<TestProblem> test = MakeBundle(5, 40, true);
  ceres::Solver::Options options;
  CeresSession session;
  SolveReport report;
  ceres::Solver::Summary summary;
  std::deque<std::vector<double>> start;

 private:
  Way way_;
};

}  // namespace inceres::testing
