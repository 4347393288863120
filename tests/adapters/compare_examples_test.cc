// The examples of docs/compare.md, compiled and run as they stand there.

#include <filesystem>
#include <iostream>
#include <string>

#include <ceres/ceres.h>
#include <gtest/gtest.h>

// clang-format off
#include <inceres/ceres/solve.h>

#include "adapters/test_problems.h"
#include "support/temp_dir.h"

namespace {

bool Compare(const ceres::Solver::Options& options, ceres::Problem& problem) {
  ceres::Solver::Summary summary;
// [quoted in docs/compare.md]
inceres::SolveOptions solve_options;
inceres::SolveReport report;
solve_options.cross_check.enabled = true;
solve_options.ab_log = "run.jsonl";                        // or leave it out: no log
inceres::Solve(options, &problem, &summary, solve_options, &report);
if (!report.comparison->agrees()) {
  for (const std::string& violation : report.comparison->violations) {
    std::cerr << violation << '\n';
  }
}
// [end of quote]
  return summary.IsSolutionUsable() && report.comparison->agrees();
}

bool AskTheEnvironment(const ceres::Solver::Options& options, ceres::Problem& problem) {
  ceres::Solver::Summary summary;
// [quoted in docs/compare.md]
inceres::Solve(options, &problem, &summary, inceres::OptionsFromEnvironment());
// [end of quote]
  return summary.IsSolutionUsable();
}
// clang-format on

TEST(CompareExamples, Run) {
  const inceres::test::TempDir directory;
  const std::filesystem::path before = std::filesystem::current_path();
  std::filesystem::current_path(directory.path());
  EXPECT_TRUE(Compare(ceres::Solver::Options(), inceres::testing::MakePowell()->problem));
  std::filesystem::current_path(before);
  EXPECT_TRUE(std::filesystem::exists(directory.File("run.jsonl")));
  EXPECT_TRUE(AskTheEnvironment(ceres::Solver::Options(), inceres::testing::MakePowell()->problem));
}

}  // namespace
