// Cross-checks: what they find, and that nobody notices them otherwise.
#include "inceres/ceres/cross_check.h"

#include <chrono>
#include <stdexcept>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/mman.h>

#include "adapters/captured_log.h"
#include "adapters/compare_with_stock.h"
#include "adapters/session_support.h"
#include "adapters/too_large_problem.h"
#include "adapters/two_faced_problem.h"
#include "inceres/ceres/session.h"
#include "inceres/ceres/solve.h"
#include "support/temp_dir.h"

namespace inceres {
namespace {

using testing::CapturedLog;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::MakeBundle;
using testing::MakeCurveFit;
using testing::MakePowell;
using testing::MakeWindow;
using testing::Recipe;
using ::testing::SizeIs;
using testing::TestProblem;
using testing::TwoFacedProblem;
using Options = ceres::Solver::Options;
using CeresSummary = ceres::Solver::Summary;

Options Quiet(ceres::LinearSolverType type = ceres::DENSE_SCHUR) {
  Options options;
  options.linear_solver_type = type;
  options.logging_type = ceres::SILENT;
  return options;
}

SolveOptions Checked(SolveMode mode = SolveMode::kExact) {
  SolveOptions asked;
  asked.mode = mode;
  asked.cross_check.enabled = true;
  return asked;
}

void ExpectSameRun(const CeresSummary& a, const CeresSummary& b) {
  EXPECT_EQ(a.termination_type, b.termination_type);
  EXPECT_EQ(a.message, b.message);
  EXPECT_EQ(a.final_cost, b.final_cost);
  ASSERT_EQ(a.iterations.size(), b.iterations.size());
  for (std::size_t k = 0; k < a.iterations.size(); ++k) {
    EXPECT_EQ(a.iterations[k].cost, b.iterations[k].cost);
  }
}

std::vector<Recipe> Recipes() {
  return {MakePowell, [] { return MakeCurveFit(0.5); }, [] { return MakeBundle(5, 40, true); },
          [] { return MakeWindow(5, 40, true); }};
}

// Memory, summary, callbacks and output are those of a solve that nobody checked.
TEST(CrossCheck, ChangesNothingButTheTimeItTakes) {
  for (const Recipe& recipe : Recipes()) {
    for (const SolvedBy keep : {SolvedBy::kOurs, SolvedBy::kStock}) {
      const auto plain = recipe();
      const auto checked = recipe();
      Options options;
      options.linear_solver_type = ceres::DENSE_SCHUR;
      options.minimizer_progress_to_stdout = true;
      testing::Recorder counter(checked.get());
      CeresSummary expected;
      if (keep == SolvedBy::kOurs) {
        inceres::Solve(Quiet(), &plain->problem, &expected);
      } else {
        ceres::Solve(Quiet(), &plain->problem, &expected);
      }
      SolveOptions asked = Checked();
      SolveReport report;
      asked.cross_check.keep = keep;
      CeresSummary summary;
      options.callbacks.push_back(&counter);
      ::testing::internal::CaptureStdout();
      inceres::Solve(options, &checked->problem, &summary, asked, &report);
      const std::string output = ::testing::internal::GetCapturedStdout();
      ASSERT_NE(report.comparison, nullptr);
      EXPECT_TRUE(report.comparison->agrees())
          << ::testing::PrintToString(report.comparison->violations);
      EXPECT_EQ(report.comparison->reason, "");
      EXPECT_EQ(report.comparison->kept, keep);
      EXPECT_EQ(checked->blocks, plain->blocks);
      ExpectSameRun(summary, expected);
      EXPECT_EQ(counter.iterations.size(), report.comparison->ours.iterations.size());
      EXPECT_EQ(std::count(output.begin(), output.end(), '\n'),
                static_cast<long>(counter.iterations.size()) + 1);
      EXPECT_GT(report.comparison->our_seconds, 0.0);
      EXPECT_GT(report.comparison->stock_seconds, 0.0);
    }
  }
}

TEST(CrossCheck, TheTimeInTheCallersCallbacksIsNotOurs) {
  const auto test = MakePowell();
  lambdas::Callback sleeper([](const ceres::IterationSummary&) {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    return ceres::SOLVER_CONTINUE;
  });
  Options options = Quiet();
  options.callbacks.push_back(&sleeper);
  SolveOptions asked = Checked();
  SolveReport report;
  CeresSummary summary;
  inceres::Solve(options, &test->problem, &summary, asked, &report);
  const double slept = 0.02 * static_cast<double>(summary.iterations.size());
  EXPECT_GE(report.callback_seconds, slept);
  EXPECT_LT(report.comparison->our_seconds, summary.total_time_in_seconds - 0.9 * slept);
}

TEST(CrossCheck, NothingIsReportedUnasked) {
  const auto test = MakePowell();
  SolveReport report;
  CeresSummary summary;
  inceres::Solve(Quiet(), &test->problem, &summary, {}, &report);
  EXPECT_EQ(report.comparison, nullptr);
}

// Of a comparison that finds something to accuse ours of: ours is solve 1 and, looked at again, 5.
bool IsStocks(int solve) {
  return solve >= 2 && solve <= 4;
}

TEST(CrossCheck, NamesTheIterationAndTheVariableThatDiffer) {
  TwoFacedProblem faced([](int solve, int call, double* residual) {
    residual[0] += IsStocks(solve) && call >= 3 ? 0.5 : 0.0;
    return true;
  });
  const CapturedLog log;
  SolveOptions asked = Checked();
  SolveReport report;
  CeresSummary summary;
  inceres::Solve(Quiet(ceres::DENSE_NORMAL_CHOLESKY), &faced.test->problem, &summary, asked,
                 &report);
  EXPECT_EQ(faced.solve, 5);
  const CrossCheckResult& result = *report.comparison;
  EXPECT_TRUE(result.compared);
  EXPECT_FALSE(result.agrees());
  EXPECT_EQ(result.first_different_iteration, 3);
  EXPECT_EQ(result.parameters.block, faced.block);
  EXPECT_EQ(result.parameters.size, 1);
  EXPECT_EQ(result.parameters.component, 0);
  EXPECT_NEAR(result.parameters.ours, 3.0, 1e-3);
  EXPECT_NEAR(result.parameters.stock, std::sqrt(8.5), 1e-2);
  EXPECT_EQ(result.parameters.ours, *faced.block);
  std::vector<double*> blocks;
  faced.test->problem.GetParameterBlocks(&blocks);
  EXPECT_EQ(blocks[static_cast<std::size_t>(result.parameters.index)], faced.block);
  EXPECT_THAT(result.violations, Contains(HasSubstr("cost of iteration 3")));
  ASSERT_THAT(log.messages(), SizeIs(1));
  for (const char* part :
       {"ours and stock Ceres disagree", "cost of iteration 3", "first iteration that differs: 3",
        "component 0 of block 0x", "\n>    3 "}) {
    EXPECT_THAT(log.messages()[0], HasSubstr(part));
  }
}

TEST(CrossCheck, AFailureOfStockAloneIsAViolation) {
  TwoFacedProblem faced([](int solve, int, double*) { return solve < 2; });
  const CapturedLog log;
  SolveOptions asked = Checked();
  SolveReport report;
  CeresSummary summary;
  inceres::Solve(Quiet(), &faced.test->problem, &summary, asked, &report);
  EXPECT_TRUE(summary.IsSolutionUsable());
  EXPECT_EQ(report.comparison->stock.termination_type, ceres::FAILURE);
  EXPECT_THAT(report.comparison->violations, Contains(HasSubstr("termination: ours CONVERGENCE")));
  EXPECT_NEAR(*faced.block, 3.0, 1e-3);
}

TEST(CrossCheck, AFailureOfOursAloneIsAViolation) {
  TwoFacedProblem faced([](int solve, int, double*) { return solve != 1; });
  const CapturedLog log;
  SolveOptions asked = Checked();
  SolveReport report;
  asked.cross_check.keep = SolvedBy::kStock;
  CeresSummary summary;
  inceres::Solve(Quiet(), &faced.test->problem, &summary, asked, &report);
  EXPECT_TRUE(summary.IsSolutionUsable());
  EXPECT_THAT(report.comparison->violations, Contains(HasSubstr("termination: ours FAILURE")));
  EXPECT_NEAR(*faced.block, 3.0, 1e-3);
}

TEST(CrossCheck, FailuresOfBothAgree) {
  TwoFacedProblem faced([](int, int, double*) { return false; });
  const auto before = faced.test->blocks;
  SolveOptions asked = Checked();
  SolveReport report;
  CeresSummary summary;
  inceres::Solve(Quiet(), &faced.test->problem, &summary, asked, &report);
  EXPECT_EQ(summary.termination_type, ceres::FAILURE);
  EXPECT_TRUE(report.comparison->agrees())
      << ::testing::PrintToString(report.comparison->violations);
  EXPECT_EQ(faced.test->blocks, before);
}

TEST(CrossCheck, AnExceptionLeavesTheStart) {
  for (const int thrower : {1, 2}) {
    TwoFacedProblem faced([&](int solve, int call, double*) {
      if (solve == thrower && call == 2) {
        throw std::runtime_error("no more");
      }
      return true;
    });
    const auto before = faced.test->blocks;
    SolveOptions asked = Checked();
    SolveReport report;
    CeresSummary summary;
    EXPECT_THROW(inceres::Solve(Quiet(), &faced.test->problem, &summary, asked, &report),
                 std::runtime_error);
    EXPECT_EQ(faced.test->blocks, before);
  }
}

TEST(CrossCheck, WhatOursDeclinesIsSolvedOnce) {
  TwoFacedProblem faced(nullptr);
  Options options = Quiet();
  options.minimizer_type = ceres::LINE_SEARCH;
  testing::Recorder counter(faced.test.get());
  options.callbacks.push_back(&counter);
  SolveOptions asked = Checked();
  SolveReport report;
  CeresSummary summary;
  inceres::Solve(options, &faced.test->problem, &summary, asked, &report);
  EXPECT_TRUE(report.used_stock);
  EXPECT_FALSE(report.comparison->compared);
  EXPECT_FALSE(report.comparison->agrees());
  EXPECT_EQ(report.comparison->reason, report.fallback_reason);
  EXPECT_EQ(report.comparison->kept, SolvedBy::kStock);
  EXPECT_EQ(counter.iterations.size(), summary.iterations.size());
  asked.strict = true;
  inceres::Solve(options, &faced.test->problem, &summary, asked, &report);
  EXPECT_EQ(summary.termination_type, ceres::FAILURE);
  EXPECT_FALSE(report.comparison->compared);
}

// The comparison has begun by then.
TEST(CrossCheck, WhatOursDeclinesOnceItHasPlannedIsSolvedOnceToo) {
  testing::TooLargeProblem large;
  const auto before = large.test.blocks;
  testing::Recorder counter(&large.test);
  Options options = testing::TooLargeProblem::Options();
  options.callbacks.push_back(&counter);
  SolveOptions asked = Checked();
  SolveReport report;
  CeresSummary summary;
  const CapturedLog log;
  inceres::Solve(options, &large.test.problem, &summary, asked, &report);
  EXPECT_TRUE(report.used_stock);
  EXPECT_THAT(report.fallback_reason, HasSubstr("memory: "));
  EXPECT_EQ(large.num_calls, 1);
  EXPECT_EQ(counter.iterations.size(), 1u);
  EXPECT_FALSE(report.comparison->compared);
  EXPECT_EQ(report.comparison->reason, report.fallback_reason);
  EXPECT_EQ(report.comparison->kept, SolvedBy::kStock);
  EXPECT_EQ(report.comparison->first, SolvedBy::kStock);
  EXPECT_EQ(report.comparison->stock.final_cost, summary.final_cost);
  EXPECT_THAT(report.comparison->ours.iterations, IsEmpty());
  asked.strict = true;
  inceres::Solve(options, &large.test.problem, &summary, asked, &report);
  EXPECT_EQ(summary.termination_type, ceres::FAILURE);
  EXPECT_EQ(large.num_calls, 1);
  EXPECT_FALSE(report.comparison->compared);
  EXPECT_EQ(report.comparison->reason, report.fallback_reason);
  EXPECT_THAT(log.messages(), IsEmpty());
  EXPECT_EQ(large.test.blocks, before);
}

// A second solve would call it again.
TEST(CrossCheck, AProblemWithAnEvaluationCallbackIsSolvedOnce) {
  int calls[2] = {0, 0};
  for (const bool checked : {false, true}) {
    lambdas::Preparation callback([&](bool, bool) { ++calls[checked ? 1 : 0]; });
    ceres::Problem::Options problem_options;
    problem_options.evaluation_callback = &callback;
    ceres::Problem problem(problem_options);
    double x = 4.0;
    problem.AddResidualBlock(new testing::TargetCost({1.0}), nullptr, &x);
    SolveOptions asked;
    SolveReport report;
    asked.evaluation_callback = &callback;
    asked.cross_check.enabled = checked;
    CeresSummary summary;
    inceres::Solve(Quiet(), &problem, &summary, asked, &report);
    EXPECT_FALSE(report.used_stock);
    if (checked) {
      EXPECT_THAT(report.comparison->reason, HasSubstr("evaluation callback"));
    }
  }
  EXPECT_GT(calls[0], 0);
  EXPECT_EQ(calls[1], calls[0]);
}

TEST(CrossCheck, StockModeIsStockAlone) {
  TwoFacedProblem faced(nullptr);
  SolveOptions asked = Checked(SolveMode::kStock);
  SolveReport report;
  CeresSummary summary;
  inceres::Solve(Quiet(), &faced.test->problem, &summary, asked, &report);
  EXPECT_EQ(faced.solve, 1);
  EXPECT_FALSE(report.comparison->compared);
}

TEST(CrossCheck, ASolveThatTheCallbackEndedStaysOurs) {
  for (const ceres::CallbackReturnType end :
       {ceres::SOLVER_TERMINATE_SUCCESSFULLY, ceres::SOLVER_ABORT}) {
    const auto plain = MakePowell();
    const auto checked = MakePowell();
    testing::Recorder first(plain.get(), 3, end), second(checked.get(), 3, end);
    Options options = Quiet();
    CeresSummary expected, summary;
    options.callbacks = {&first};
    inceres::Solve(options, &plain->problem, &expected);
    options.callbacks = {&second};
    SolveOptions asked = Checked();
    SolveReport report;
    asked.cross_check.keep = SolvedBy::kStock;
    inceres::Solve(options, &checked->problem, &summary, asked, &report);
    EXPECT_EQ(report.comparison->kept, SolvedBy::kOurs);
    EXPECT_TRUE(report.comparison->agrees());
    EXPECT_THAT(report.comparison->reason, HasSubstr("callback"));
    EXPECT_EQ(checked->blocks, plain->blocks);
    ASSERT_EQ(second.iterations.size(), first.iterations.size());
    for (std::size_t k = 0; k < first.iterations.size(); ++k) {
      EXPECT_EQ(second.iterations[k].iteration, first.iterations[k].iteration);
    }
    ExpectSameRun(summary, expected);
  }
}

TEST(CrossCheck, TheEndOfASolveThatTheClockEndedIsNotJudged) {
  const auto test = MakeBundle(5, 40, true);
  Options options = Quiet();
  options.max_solver_time_in_seconds = 1e-9;
  SolveOptions asked = Checked();
  SolveReport report;
  CeresSummary summary;
  inceres::Solve(options, &test->problem, &summary, asked, &report);
  EXPECT_TRUE(report.comparison->agrees());
  EXPECT_THAT(report.comparison->reason, HasSubstr("time limit"));
}

TEST(CrossCheck, TheOrderingStaysTheCallers) {
  const auto test = MakeBundle(4, 20, true);
  Options options = Quiet();
  options.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (std::vector<double>& block : test->blocks) {
    options.linear_solver_ordering->AddElementToGroup(block.data(), block.size() == 3 ? 0 : 1);
  }
  const auto before = options.linear_solver_ordering->group_to_elements();
  SolveOptions asked = Checked();
  SolveReport report;
  CeresSummary summary;
  inceres::Solve(options, &test->problem, &summary, asked, &report);
  EXPECT_TRUE(report.comparison->agrees());
  EXPECT_EQ(options.linear_solver_ordering->group_to_elements(), before);
}

TEST(CrossCheck, ConstantBlocksAreNeverWritten) {
  const std::size_t bytes = 4096;
  auto* page = static_cast<double*>(
      mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0));
  ASSERT_NE(page, MAP_FAILED);
  page[0] = 2.0;
  const auto test = MakePowell();
  test->problem.AddResidualBlock(new testing::TargetCost({1.0}), nullptr, page);
  test->problem.SetParameterBlockConstant(page);
  ASSERT_EQ(mprotect(page, bytes, PROT_READ), 0);
  SolveOptions asked = Checked();
  SolveReport report;
  CeresSummary summary;
  inceres::Solve(Quiet(), &test->problem, &summary, asked, &report);
  EXPECT_TRUE(report.comparison->agrees());
  EXPECT_EQ(report.comparison->ours.fixed_cost, 0.5);
}

TEST(CrossCheck, TolerancesAreTheCallers) {
  const auto test = MakeBundle(5, 40, true);
  const CapturedLog log;
  SolveOptions asked = Checked();
  SolveReport report;
  asked.cross_check.parameter_tolerance = 0.0;
  asked.cross_check.spread_factor = 0.0;  // stock's own solvers do not keep to that either
  CeresSummary summary;
  inceres::Solve(Quiet(), &test->problem, &summary, asked, &report);
  ASSERT_THAT(report.comparison->violations, SizeIs(1));
  EXPECT_THAT(report.comparison->violations[0], HasSubstr("parameter block 0x"));
  EXPECT_GT(report.comparison->parameters.relative, 0.0);
}

TEST(CrossCheck, ATwistedToleranceIsNamedAndTheSolveGoesOn) {
  TwoFacedProblem faced(nullptr);
  const CapturedLog log;
  SolveOptions asked = Checked();
  SolveReport report;
  asked.cross_check.cost_tolerance = -1.0;
  CeresSummary summary;
  inceres::Solve(Quiet(), &faced.test->problem, &summary, asked, &report);
  EXPECT_TRUE(summary.IsSolutionUsable());
  EXPECT_EQ(faced.solve, 1);
  EXPECT_THAT(report.comparison->reason, HasSubstr("cost_tolerance"));
  EXPECT_THAT(log.messages(), Contains(HasSubstr("cost_tolerance")));
}

TEST(CrossCheck, WhatStockWouldAbortOnIsNotCompared) {
  if (CERES_VERSION_MINOR >= 2) {
    GTEST_SKIP() << "from Ceres 2.2 on use_mixed_precision_solves with SUITE_SPARSE is an invalid "
                    "option, and goes to stock as such";
  }
  const auto test = MakePowell();
  Options options = Quiet(ceres::SPARSE_NORMAL_CHOLESKY);
  options.use_mixed_precision_solves = true;
  SolveOptions asked = Checked();
  SolveReport report;
  CeresSummary summary;
  inceres::Solve(options, &test->problem, &summary, asked, &report);
  EXPECT_TRUE(summary.IsSolutionUsable());
  EXPECT_FALSE(report.comparison->compared);
  EXPECT_THAT(report.comparison->reason, HasSubstr("mixed_precision"));
}

TEST(CrossCheck, IncrementalModeIsJudgedByItsCost) {
  for (const Recipe& recipe : Recipes()) {
    const auto test = recipe();
    SolveOptions asked = Checked(SolveMode::kIncremental);
    SolveReport report;
    CeresSummary summary;
    inceres::Solve(Quiet(), &test->problem, &summary, asked, &report);
    EXPECT_TRUE(report.comparison->agrees())
        << ::testing::PrintToString(report.comparison->violations);
    EXPECT_EQ(report.comparison->first_different_iteration, -1);
  }
  const CapturedLog log;
  TwoFacedProblem faced([](int solve, int, double* residual) {
    residual[0] += IsStocks(solve) ? 1.0 : 0.0;
    return true;
  });
  faced.test->problem.AddResidualBlock(new testing::TargetCost({1.0}), nullptr, faced.block);
  SolveOptions asked = Checked(SolveMode::kIncremental);
  SolveReport report;
  CeresSummary summary;
  inceres::Solve(Quiet(), &faced.test->problem, &summary, asked, &report);
  EXPECT_THAT(report.comparison->violations, Contains(HasSubstr("final cost")));
}

// Of stock, which goes first in the second comparison of a log: the session has not looked at the
// problem by then, and nobody tells it of the edits again.
TEST(CrossCheck, AnExceptionHidesNoEditFromASession) {
  const test::TempDir directory;
  testing::Pull a(1.0, 1.0), b(3.0, 1.0), c(101.0, 1.0);
  double x = 0.0;
  ceres::Problem problem(testing::Borrowing());
  problem.AddResidualBlock(&a, nullptr, &x);
  const ceres::ResidualBlockId pull = problem.AddResidualBlock(&b, nullptr, &x);
  CeresSession session{testing::AlwaysIncremental()};
  SolveOptions asked;
  asked.ab_log = directory.File("ab.jsonl");
  CeresSummary summary;
  session.Solve(Quiet(ceres::DENSE_NORMAL_CHOLESKY), &problem, &summary, asked);
  EXPECT_NEAR(x, 2.0, 0.1);
  problem.RemoveResidualBlock(pull);
  problem.AddResidualBlock(&c, nullptr, &x);
  a.on_call = [] { throw std::runtime_error("no more"); };
  EXPECT_THROW(session.Solve(Quiet(ceres::DENSE_NORMAL_CHOLESKY), &problem, &summary, asked),
               std::runtime_error);
  a.on_call = nullptr;
  asked.problem_unedited = true;
  session.Solve(Quiet(ceres::DENSE_NORMAL_CHOLESKY), &problem, &summary, asked);
  EXPECT_NEAR(x, 51.0, 0.1);
}

TEST(CrossCheck, ASessionGoesOnFromWhatItWrote) {
  const auto test = MakeWindow(5, 40, true);
  CeresSession session{inceres::testing::AlwaysIncremental()};
  SolveOptions asked = Checked();
  SolveReport report;
  CeresSummary summary;
  session.Solve(Quiet(), &test->problem, &summary, asked, &report);
  EXPECT_TRUE(report.comparison->agrees())
      << ::testing::PrintToString(report.comparison->violations);
  session.Solve(Quiet(), &test->problem, &summary, asked, &report);
  EXPECT_TRUE(report.comparison->agrees())
      << ::testing::PrintToString(report.comparison->violations);
  EXPECT_EQ(report.changes.num_revalued_variables, 0);
  EXPECT_GT(report.changes.num_kept_factors, 0);
}

}  // namespace
}  // namespace inceres
