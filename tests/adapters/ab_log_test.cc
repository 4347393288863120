// The A/B log, and the environment that asks for it.
#include "adapters/ceres/compare/ab_log.h"

#include <unistd.h>

#include <clocale>
#include <cstdlib>
#include <map>
#include <sstream>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <sys/wait.h>

#include "adapters/captured_log.h"
#include "adapters/ceres/report/environment.h"
#include "adapters/test_problems.h"
#include "adapters/too_large_problem.h"
#include "adapters/two_faced_problem.h"
#include "inceres/ceres/solve.h"
#include "support/temp_dir.h"

namespace inceres {
namespace {

using nlohmann::json;
using ::testing::AllOf;
using testing::CapturedLog;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::SizeIs;

ceres::Solver::Options Quiet() {
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.logging_type = ceres::SILENT;
  return options;
}

std::vector<json> Lines(const std::string& path) {
  std::istringstream text(test::ReadBytes(path));
  std::vector<json> lines;
  for (std::string line; std::getline(text, line);) {
    lines.push_back(json::parse(line));
  }
  return lines;
}

SolveOptions Logging(const std::string& path, SolveMode mode = SolveMode::kExact) {
  SolveOptions asked;
  asked.mode = mode;
  asked.ab_log = path;
  return asked;
}

TEST(AbLog, ALineTellsOfBothSolves) {
  const test::TempDir directory;
  const std::string path = directory.File("ab.jsonl");
  const auto test = testing::MakeBundle(5, 40, true);
  SolveOptions asked = Logging(path);
  SolveReport report;
  ceres::Solver::Summary summary;
  inceres::Solve(Quiet(), &test->problem, &summary, asked, &report);
  const auto lines = Lines(path);
  ASSERT_THAT(lines, SizeIs(1));
  const json& line = lines[0];
  const CrossCheckResult& result = *report.comparison;
  EXPECT_EQ(line["mode"], "exact");
  EXPECT_EQ(line["process"], getpid());
  EXPECT_EQ(line["first"], "ours");
  EXPECT_EQ(line["kept"], "ours");
  EXPECT_EQ(line["fallback_reason"], "");
  EXPECT_EQ(line["sizes"]["residuals"], summary.num_residuals_reduced);
  EXPECT_EQ(line["sizes"]["parameter_blocks"], summary.num_parameter_blocks_reduced);
  EXPECT_EQ(line["structure"]["landmarks"], report.num_landmarks);
  EXPECT_EQ(line["structure"]["reduced_solver"], report.core.reduced_solver);
  EXPECT_EQ(line["structure"]["linear_solver_used"], "DENSE_SCHUR");
  EXPECT_EQ(line["ours"]["seconds"], result.our_seconds);
  EXPECT_EQ(line["stock"]["seconds"], result.stock_seconds);
  EXPECT_EQ(line["ours"]["final_cost"], result.ours.final_cost);
  EXPECT_EQ(line["stock"]["final_cost"], result.stock.final_cost);
  EXPECT_EQ(line["ours"]["iterations"], result.ours.iterations.back().iteration);
  EXPECT_EQ(line["ours"]["termination"], "CONVERGENCE");
  EXPECT_EQ(line["ours"]["stages"]["jacobians"], report.core.seconds.jacobians);
  EXPECT_EQ(line["ours"]["work"]["reduced_size"], report.core.work.reduced_size);
  EXPECT_EQ(line["difference"]["cost"], result.cost_difference);
  EXPECT_EQ(line["difference"]["parameter"], result.parameters.relative);
  EXPECT_TRUE(line["difference"]["violations"].empty());
  EXPECT_TRUE(line["difference"]["within_spread"].empty());
  EXPECT_TRUE(line["difference"]["spread"].is_null());
  EXPECT_EQ(line["difference"]["tolerances"]["cost"], 1e-9);
  EXPECT_EQ(line["difference"]["tolerances"]["iterations"], 1.0);
  EXPECT_FALSE(line["machine"]["cpu"].get<std::string>().empty());
  EXPECT_THAT(line["time"].get<std::string>(), ::testing::MatchesRegex("20..-..-..T..:..:......Z"));
}

// In an order without a rhythm: 0 1 1 0 1 0 0 1. What only one of the two solves does not count.
TEST(AbLog, TheTwoTakeTurns) {
  const test::TempDir directory;
  const std::string path = directory.File("ab.jsonl");
  std::vector<std::string> first;
  for (int k = 0; k < 8; ++k) {
    const auto test = testing::MakePowell();
    SolveOptions asked = Logging(path);
    SolveReport report;
    ceres::Solver::Summary summary;
    inceres::Solve(Quiet(), &test->problem, &summary, asked, &report);
    EXPECT_TRUE(report.comparison->agrees());
    first.push_back(Lines(path).back()["first"]);
    asked.mode = SolveMode::kStock;
    inceres::Solve(Quiet(), &test->problem, &summary, asked, &report);
  }
  EXPECT_THAT(first,
              ElementsAre("ours", "stock", "stock", "ours", "stock", "ours", "ours", "stock"));
}

// Neither has solved it, so there is nothing to write down.
TEST(AbLog, ARefusalIsNoSolve) {
  const test::TempDir directory;
  const auto test = testing::MakePowell();
  ceres::Solver::Options options = Quiet();
  options.minimizer_type = ceres::LINE_SEARCH;
  SolveOptions asked = Logging(directory.File("ab.jsonl"));
  SolveReport report;
  asked.strict = true;
  ceres::Solver::Summary summary;
  inceres::Solve(options, &test->problem, &summary, asked, &report);
  EXPECT_EQ(summary.termination_type, ceres::FAILURE);
  EXPECT_THAT(Lines(asked.ab_log), SizeIs(0));
}

// Ours finds out when it plans. The line is of the solve that the caller has, not of one of stock's
// that went first.
TEST(AbLog, WhatOursDeclinesOnceItHasPlannedIsStocksAlone) {
  const test::TempDir directory;
  testing::TooLargeProblem large;
  SolveOptions asked = Logging(directory.File("ab.jsonl"));
  for (const bool stock_first : {false, true}) {
    large.num_calls = 0;
    SolveReport report;
    ceres::Solver::Summary summary;
    inceres::Solve(testing::TooLargeProblem::Options(), &large.test.problem, &summary, asked,
                   &report);
    EXPECT_EQ(large.num_calls, stock_first ? 2 : 1);
    const json line = Lines(asked.ab_log).back();
    EXPECT_TRUE(line["ours"].is_null());
    EXPECT_TRUE(line["difference"].is_null());
    EXPECT_EQ(line["stock"]["final_cost"], summary.final_cost);
    EXPECT_EQ(line["first"], "stock");
    EXPECT_EQ(line["kept"], "stock");
    EXPECT_THAT(line["fallback_reason"].get<std::string>(), HasSubstr("memory: "));
    EXPECT_EQ(line["not_compared"], line["fallback_reason"]);
  }
  asked.strict = true;
  SolveReport report;
  ceres::Solver::Summary summary;
  inceres::Solve(testing::TooLargeProblem::Options(), &large.test.problem, &summary, asked,
                 &report);
  EXPECT_EQ(summary.termination_type, ceres::FAILURE);
  EXPECT_THAT(Lines(asked.ab_log), SizeIs(2));
}

// Whoever goes first, memory ends as ours left it.
TEST(AbLog, MemoryIsOursWhoeverGoesFirst) {
  const test::TempDir directory;
  const auto plain = testing::MakeBundle(5, 40, true);
  ceres::Solver::Summary summary;
  inceres::Solve(Quiet(), &plain->problem, &summary);
  for (int k = 0; k < 2; ++k) {
    const auto test = testing::MakeBundle(5, 40, true);
    SolveOptions asked = Logging(directory.File("ab.jsonl"));
    SolveReport report;
    inceres::Solve(Quiet(), &test->problem, &summary, asked, &report);
    EXPECT_EQ(test->blocks, plain->blocks);
  }
}

TEST(AbLog, ViolationsAreWrittenDown) {
  const test::TempDir directory;
  const CapturedLog log;
  testing::TwoFacedProblem faced([](int solve, int call, double* residual) {
    residual[0] += solve >= 2 && call >= 3 ? 0.5 : 0.0;
    return true;
  });
  SolveOptions asked = Logging(directory.File("ab.jsonl"));
  SolveReport report;
  ceres::Solver::Summary summary;
  inceres::Solve(Quiet(), &faced.test->problem, &summary, asked, &report);
  const json line = Lines(asked.ab_log).at(0);
  EXPECT_EQ(line["difference"]["first_iteration"], 3);
  EXPECT_EQ(line["difference"]["parameter_block"], report.comparison->parameters.index);
  EXPECT_THAT(line["difference"]["violations"].at(0).get<std::string>(),
              HasSubstr("cost of iteration 3"));
  EXPECT_TRUE(line["difference"]["within_spread"].empty());
  EXPECT_THAT(line["difference"]["spread"]["linear_solvers"].get<std::string>(),
              HasSubstr("DENSE_SCHUR, SPARSE_SCHUR"));
}

TEST(AbLog, FallbacksStockAndIncrementalMode) {
  const test::TempDir directory;
  const std::string path = directory.File("ab.jsonl");
  ceres::Solver::Summary summary;
  auto test = testing::MakePowell();
  ceres::Solver::Options options = Quiet();
  options.minimizer_type = ceres::LINE_SEARCH;
  SolveOptions asked = Logging(path);
  SolveReport report;
  inceres::Solve(options, &test->problem, &summary, asked, &report);
  asked.mode = SolveMode::kStock;
  inceres::Solve(Quiet(), &test->problem, &summary, asked, &report);
  test = testing::MakePowell();
  asked.mode = SolveMode::kIncremental;
  inceres::Solve(Quiet(), &test->problem, &summary, asked, &report);
  const auto lines = Lines(path);
  ASSERT_THAT(lines, SizeIs(3));
  EXPECT_TRUE(lines[0]["ours"].is_null());
  EXPECT_TRUE(lines[0]["difference"].is_null());
  EXPECT_GT(lines[0]["stock"]["seconds"], 0.0);
  EXPECT_THAT(lines[0]["fallback_reason"].get<std::string>(), HasSubstr("LINE_SEARCH"));
  EXPECT_EQ(lines[1]["mode"], "stock");
  EXPECT_TRUE(lines[1]["ours"].is_null());
  EXPECT_EQ(lines[2]["mode"], "incremental");
  EXPECT_EQ(lines[2]["ours"]["update"]["num_iterations"], report.update.num_iterations);
}

TEST(AbLog, ConcurrentSolvesAndProcessesDoNotMixTheirLines) {
  const test::TempDir directory;
  const std::string path = directory.File("ab.jsonl");
  const int num_lines = 200;
  std::vector<pid_t> children;
  for (int child = 0; child < 3; ++child) {
    const pid_t pid = fork();
    ASSERT_GE(pid, 0);
    if (pid == 0) {
      const std::string line = json({{"child", child}, {"filler", std::string(20000, 'x')}}).dump();
      for (int k = 0; k < num_lines; ++k) {
        internal::AppendToLog(path, line);
      }
      _exit(0);
    }
    children.push_back(pid);
  }
  std::vector<std::thread> threads;
  for (int t = 0; t < 3; ++t) {
    threads.emplace_back([&] {
      for (int k = 0; k < 10; ++k) {
        const auto test = testing::MakePowell();
        SolveOptions asked = Logging(path);
        SolveReport report;
        ceres::Solver::Summary summary;
        inceres::Solve(Quiet(), &test->problem, &summary, asked, &report);
      }
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  for (const pid_t pid : children) {
    int status = -1;
    waitpid(pid, &status, 0);
    EXPECT_EQ(status, 0);
  }
  std::map<int, int> by_child;
  std::vector<std::int64_t> numbers;
  for (const json& line : Lines(path)) {  // every line parses
    ++by_child[line.value("child", -1)];
    if (line.contains("solve")) {
      numbers.push_back(line["solve"]);
    }
  }
  EXPECT_EQ(by_child,
            (std::map<int, int>{{-1, 30}, {0, num_lines}, {1, num_lines}, {2, num_lines}}));
  std::sort(numbers.begin(), numbers.end());
  for (std::size_t k = 0; k < numbers.size(); ++k) {
    EXPECT_EQ(numbers[k], static_cast<std::int64_t>(k));
  }
}

TEST(AbLog, AFileThatCannotBeWrittenIsNamedOnce) {
  const test::TempDir directory;
  const std::string path = directory.File("no/such/folder.jsonl");
  const CapturedLog log;
  for (int k = 0; k < 3; ++k) {
    const auto test = testing::MakePowell();
    SolveOptions asked = Logging(path);
    SolveReport report;
    ceres::Solver::Summary summary;
    inceres::Solve(Quiet(), &test->problem, &summary, asked, &report);
    EXPECT_TRUE(summary.IsSolutionUsable());
    EXPECT_TRUE(report.comparison->agrees());
  }
  ASSERT_THAT(log.messages(), SizeIs(1));
  EXPECT_THAT(log.messages()[0], AllOf(HasSubstr(path), HasSubstr("No such file or directory")));
}

internal::Environment Read(const std::map<std::string, std::string>& variables) {
  return internal::ReadEnvironment([&](const char* name) {
    const auto found = variables.find(name);
    return found == variables.end() ? nullptr : found->second.c_str();
  });
}

TEST(Environment, NothingSetAsksForNothing) {
  for (const auto& environment :
       {Read({}), Read({{"INCERES_MODE", ""}, {"INCERES_CROSS_CHECK", ""}, {"INCERES_AB_LOG", ""}}),
        Read({{"INCERES_CROSS_CHECK", "0"}})}) {
    EXPECT_EQ(environment.mode, internal::DropinMode::kExact);
    EXPECT_FALSE(environment.cross_check.enabled);
    EXPECT_EQ(environment.ab_log, "");
    EXPECT_TRUE(environment.complaints.empty());
  }
}

TEST(Environment, EveryVariable) {
  const auto environment = Read(
      {{"INCERES_MODE", "incremental"},
       {"INCERES_CROSS_CHECK", "keep=stock,cost=1e-5,parameters=2,iterations=3,radius=0,spread=4"},
       {"INCERES_AB_LOG", "run.jsonl"}});
  EXPECT_TRUE(environment.complaints.empty());
  EXPECT_EQ(environment.mode, internal::DropinMode::kIncremental);
  EXPECT_TRUE(environment.cross_check.enabled);
  EXPECT_EQ(environment.cross_check.keep, SolvedBy::kStock);
  EXPECT_EQ(environment.cross_check.cost_tolerance, 1e-5);
  EXPECT_EQ(environment.cross_check.parameter_tolerance, 2.0);
  EXPECT_EQ(environment.cross_check.iteration_tolerance, 3);
  EXPECT_EQ(environment.cross_check.radius_tolerance, 0.0);
  EXPECT_EQ(environment.cross_check.spread_factor, 4.0);
  EXPECT_EQ(environment.ab_log, "run.jsonl");
  EXPECT_EQ(Read({{"INCERES_MODE", "stock"}}).mode, internal::DropinMode::kStock);
  EXPECT_EQ(Read({{"INCERES_MODE", "auto"}}).mode, internal::DropinMode::kAuto);
  EXPECT_EQ(Read({{"INCERES_MODE", "fallback"}}).mode, internal::DropinMode::kFallback);
  EXPECT_TRUE(Read({{"INCERES_CROSS_CHECK", "1"}}).cross_check.enabled);
}

// tests/tools/ab_report_page_test.py runs this one with the variables set and looks at the log and
// at the page drawn from it.
TEST(Environment, ThatOfThisProcess) {
  const bool comparing = std::getenv("INCERES_AB_LOG") != nullptr;
  for (int k = 0; k < 12; ++k) {
    const auto test = testing::MakeWindow(4 + k % 3, 30, true);
    ceres::Solver::Options options = Quiet();
    options.minimizer_type = k == 5 ? ceres::LINE_SEARCH : ceres::TRUST_REGION;
    SolveOptions asked = OptionsFromEnvironment();
    SolveReport report;
    ceres::Solver::Summary summary;
    inceres::Solve(options, &test->problem, &summary, asked, &report);
    EXPECT_TRUE(summary.IsSolutionUsable());
    ASSERT_EQ(report.comparison != nullptr, comparing);
    if (comparing) {
      EXPECT_EQ(report.comparison->compared, k != 5);
      EXPECT_THAT(report.comparison->violations, ::testing::IsEmpty());
    }
  }
}

// While it lives numbers have a decimal comma, if the machine knows a language with one.
class DecimalComma {
 public:
  DecimalComma() : before_(std::setlocale(LC_NUMERIC, nullptr)) {
    for (const char* name : {"de_DE.UTF-8", "de_DE.utf8", "fr_FR.UTF-8", "es_ES.UTF-8",
                             "it_IT.UTF-8", "pl_PL.UTF-8", "ru_RU.UTF-8", "pt_BR.UTF-8"}) {
      if (std::setlocale(LC_NUMERIC, name) != nullptr && *std::localeconv()->decimal_point == ',') {
        return;
      }
    }
  }
  ~DecimalComma() { std::setlocale(LC_NUMERIC, before_.c_str()); }
  DecimalComma(const DecimalComma&) = delete;
  DecimalComma& operator=(const DecimalComma&) = delete;

 private:
  const std::string before_;
};

TEST(Environment, NumbersHaveAPointInEveryLanguage) {
  const DecimalComma comma;
  if (*std::localeconv()->decimal_point != ',') {
    GTEST_SKIP() << "no locale with a decimal comma is installed (de_DE.UTF-8 or another)";
  }
  const auto environment = Read({{"INCERES_CROSS_CHECK", "cost=0.25,parameters=1e-3,spread=2.5"}});
  EXPECT_THAT(environment.complaints, ::testing::IsEmpty());
  EXPECT_EQ(environment.cross_check.cost_tolerance, 0.25);
  EXPECT_EQ(environment.cross_check.parameter_tolerance, 1e-3);
  EXPECT_EQ(environment.cross_check.spread_factor, 2.5);
}

TEST(Environment, IterationsAreAWholeNumber) {
  for (const char* text : {"2.7", "2.0", "-1", "", "99999999999", "two"}) {
    const auto environment =
        Read({{"INCERES_CROSS_CHECK", std::string("cost=0.5,iterations=") + text}});
    ASSERT_THAT(environment.complaints, SizeIs(1)) << text;
    EXPECT_THAT(environment.complaints[0], HasSubstr("\"iterations=" + std::string(text) + "\""));
    EXPECT_FALSE(environment.cross_check.iteration_tolerance.has_value()) << text;
    EXPECT_EQ(environment.cross_check.cost_tolerance, 0.5);
  }
}

TEST(Environment, UnknownValuesAreNamedAndTheRestHolds) {
  const auto environment =
      Read({{"INCERES_MODE", "fast"},
            {"INCERES_CROSS_CHECK", "1,keep=both,cost=-1,yes,parameters=1e-3"}});
  ASSERT_THAT(environment.complaints, SizeIs(4));
  EXPECT_THAT(environment.complaints[0],
              AllOf(HasSubstr("INCERES_MODE"), HasSubstr("\"fast\""), HasSubstr("exact")));
  EXPECT_THAT(environment.complaints[1], HasSubstr("\"keep=both\""));
  EXPECT_THAT(environment.complaints[2], HasSubstr("\"cost=-1\""));
  EXPECT_THAT(environment.complaints[3], HasSubstr("\"yes\""));
  EXPECT_EQ(environment.mode, internal::DropinMode::kExact);
  EXPECT_TRUE(environment.cross_check.enabled);
  EXPECT_EQ(environment.cross_check.parameter_tolerance, 1e-3);
}

}  // namespace
}  // namespace inceres
