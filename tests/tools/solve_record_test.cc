#include "tools/solve/solve_record.h"

#include <dlfcn.h>

#include <cstdlib>

#include <gtest/gtest.h>

#include "tools/solve/stock_threads.h"

namespace inceres::tools {
namespace {

const std::vector<CostSample> kTrace = {
    {0.1, 200.0, true}, {0.2, 101.0, true}, {0.3, 100.0, false}, {0.4, 100.0001, true}};

TEST(TimeToGap, IsTheFirstAcceptedSampleWithinTheGap) {
  EXPECT_EQ(TimeToGap(kTrace, 100.0, 1.0), 0.1);
  EXPECT_EQ(TimeToGap(kTrace, 100.0, 1e-2), 0.2);
  EXPECT_EQ(TimeToGap(kTrace, 100.0, 1e-5), 0.4);
}

TEST(TimeToGap, IgnoresRejectedCandidates) {
  EXPECT_EQ(TimeToGap(kTrace, 100.0, 1e-3), 0.4);
}

TEST(TimeToGap, IsEmptyIfTheCostNeverGotThere) {
  EXPECT_EQ(TimeToGap(kTrace, 100.0, 1e-7), std::nullopt);
  EXPECT_EQ(TimeToGap({}, 100.0, 1.0), std::nullopt);
}

TEST(TimeToGap, CountsCostsBelowTheReference) {
  EXPECT_EQ(TimeToGap(kTrace, 300.0, 1e-5), 0.1);
}

TEST(RecordOf, CountsCompletedIterationsWithoutTheStart) {
  ceres::Solver::Summary summary;
  summary.termination_type = ceres::NO_CONVERGENCE;
  summary.message = "Maximum number of iterations reached.";
  summary.initial_cost = 3.0;
  summary.final_cost = 2.0;
  for (int i = 0; i < 3; ++i) {
    ceres::IterationSummary iteration;
    iteration.cost = 3.0 - 0.5 * i;
    iteration.cumulative_time_in_seconds = 0.25 * i;
    iteration.step_is_successful = i != 1;
    summary.iterations.push_back(iteration);
  }
  const SolveRecord record = RecordOf(summary, 1.5);
  EXPECT_TRUE(record.usable);
  EXPECT_EQ(record.termination, "NO_CONVERGENCE");
  EXPECT_EQ(record.iterations, 2);
  EXPECT_EQ(record.seconds, 1.5);
  ASSERT_EQ(record.trace.size(), 3U);
  EXPECT_EQ(record.trace[2].cost, 2.0);
  EXPECT_EQ(record.trace[2].seconds, 0.5);
  EXPECT_FALSE(record.trace[1].accepted);
  EXPECT_TRUE(record.trace[2].accepted);
}

TEST(RecordOf, AFailureIsNotUsable) {
  EXPECT_FALSE(RecordOf(ceres::Solver::Summary(), 0.0).usable);
  EXPECT_FALSE(RecordOf(Summary(), 0.0).usable);
}

TEST(RecordOf, KeepsWhatTheShimReports) {
  SolveReport report;
  report.used_stock = true;
  report.fallback_reason = "because";
  report.options_without_effect = {"eta"};
  const SolveRecord record = RecordOf(ceres::Solver::Summary(), SolveMode::kExact, report, 0.0);
  EXPECT_TRUE(record.used_stock);
  EXPECT_EQ(record.fallback_reason, "because");
  EXPECT_EQ(record.options_without_effect, std::vector<std::string>{"eta"});
}

TEST(RecordOf, NamesTheCoresStages) {
  Summary summary;
  summary.termination = Termination::kConvergence;
  summary.seconds.elimination = 0.125;
  const SolveRecord record = RecordOf(summary, 0.5);
  EXPECT_TRUE(record.usable);
  EXPECT_EQ(record.termination, "CONVERGENCE");
  bool found = false;
  for (const auto& [stage, seconds] : record.stage_seconds) {
    found |= stage == "elimination" && seconds == 0.125;
  }
  EXPECT_TRUE(found);
}

// Comparisons of one thread with one thread: stock's OpenMP is held there, unless the user decides.
TEST(StockThreads, AreOneWhereOneIsAskedForAndNobodyHasDecided) {
  const auto levels = reinterpret_cast<int (*)()>(dlsym(RTLD_DEFAULT, "omp_get_max_active_levels"));
  if (levels == nullptr || std::getenv("OMP_MAX_ACTIVE_LEVELS") != nullptr) {
    GTEST_SKIP() << "no OpenMP here, or its threads are chosen already";
  }
  const int before = levels();
  ASSERT_GT(before, 0);
  KeepStockOnItsThreads(2);
  EXPECT_EQ(levels(), before);
  setenv("OMP_MAX_ACTIVE_LEVELS", "1", 1);
  KeepStockOnItsThreads(1);
  EXPECT_EQ(levels(), before);
  unsetenv("OMP_MAX_ACTIVE_LEVELS");
  KeepStockOnItsThreads(1);
  EXPECT_EQ(levels(), 0);
}

}  // namespace
}  // namespace inceres::tools
