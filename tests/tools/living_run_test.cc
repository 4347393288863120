// A user's program: one problem that grows and one rebuilt for each step see the same; so does
// stock's side of a replay.
#include "tools/replay/living_run.h"

#include <algorithm>

#include <gtest/gtest.h>

#include "tools/replay/replay_scripts.h"
#include "tools/small_keyframes.h"
#include "tools/small_problems.h"
#include "tools/small_replays.h"

namespace inceres::tools {
namespace {

std::vector<ReplayScript> SomeScripts() {
  ReplayScript planar;
  EXPECT_TRUE(MakePoseGraphReplay(NoisyPoseGraph(2, 15), &planar).ok());
  return {MakeBalReplay(SmallBal(6, 40), {}), MakeKeyframeReplay(SmallKeyframes(9)),
          MakeStereoReplay(SmallStereo(8)), planar};
}

ReplaySettings SettingsOf(const ReplayScript& script) {
  ReplaySettings settings;
  settings.dogleg = script.dogleg;
  EXPECT_TRUE(
      ParseReplayLinearSolver("", "auto", HasLandmarks(script), &settings.linear_solver).ok());
  return settings;
}

TEST(LivingRun, GrowingAndRebuildingEndWhereAReplayOfStockDoes) {
  for (const ReplayScript& script : SomeScripts()) {
    const ReplaySettings settings = SettingsOf(script);
    LivingReport plain, rebuilt;
    ASSERT_TRUE(PlayLiving(script, 0, settings, LivingMode::kPlain, PlainCeresSolve, &plain).ok());
    ASSERT_TRUE(
        PlayLiving(script, 0, settings, LivingMode::kRebuild, PlainCeresSolve, &rebuilt).ok());
    const std::unique_ptr<ReplaySolver> stock = MakeStockReplaySolver(settings);
    ASSERT_EQ(plain.solves.size(), script.steps.size());
    ASSERT_EQ(rebuilt.solves.size(), script.steps.size());
    for (std::size_t i = 0; i < script.steps.size(); ++i) {
      ASSERT_TRUE(stock->AddStep(script.steps[i]).ok());
      const ReplayOutcome expected = stock->Solve();
      ASSERT_TRUE(expected.usable);
      // Ceres orders blocks by address, so that sums may round otherwise.
      for (const LivingReport* report : {&plain, &rebuilt}) {
        const ReplayOutcome& solve = report->solves[i];
        EXPECT_NEAR(solve.initial_cost, expected.initial_cost,
                    1e-9 * (expected.initial_cost + 1e-9))
            << script.description;
        EXPECT_NEAR(solve.final_cost, expected.final_cost, 1e-9 * (expected.final_cost + 1e-9))
            << script.description;
      }
    }
    EXPECT_GT(plain.total_seconds, plain.solves.front().seconds);
  }
}

TEST(LivingRun, RebuildingHandsEachSolveANewProblemOverTheSameBlocks) {
  const ReplayScript script = MakeKeyframeReplay(SmallKeyframes(6));
  std::vector<std::vector<double*>> blocks;
  std::vector<int> residual_blocks;
  const CeresSolveFunction look = [&](const ceres::Solver::Options& options,
                                      ceres::Problem* problem, ceres::Solver::Summary* summary) {
    problem->GetParameterBlocks(&blocks.emplace_back());
    residual_blocks.push_back(problem->NumResidualBlocks());
    ceres::Solve(options, problem, summary);
  };
  LivingReport report;
  ASSERT_TRUE(PlayLiving(script, 4, SettingsOf(script), LivingMode::kRebuild, look, &report).ok());
  ASSERT_EQ(blocks.size(), 4u);
  int factors = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    factors += static_cast<int>(script.steps[i].factors.size());
    EXPECT_EQ(residual_blocks[i], factors);
    if (i > 0) {
      ASSERT_LT(blocks[i - 1].size(), blocks[i].size());
      EXPECT_TRUE(std::equal(blocks[i - 1].begin(), blocks[i - 1].end(), blocks[i].begin()));
    }
  }
}

TEST(LivingRun, AtOnce) {
  const ReplayScript script = MakeKeyframeReplay(SmallKeyframes(9));
  LivingReport report;
  ASSERT_TRUE(PlayAtOnce(script, 0, SettingsOf(script), PlainCeresSolve, &report).ok());
  ASSERT_EQ(report.solves.size(), 1u);
  LivingReport growing;
  ASSERT_TRUE(
      PlayLiving(script, 0, SettingsOf(script), LivingMode::kPlain, PlainCeresSolve, &growing)
          .ok());
  EXPECT_NEAR(report.solves[0].final_cost, growing.solves.back().final_cost,
              1e-4 * growing.solves.back().final_cost);

  LivingReport file;
  const BalSource source(SmallBal(6, 40));
  ASSERT_TRUE(PlayAtOnce(source, kUnitHuber, {}, PlainCeresSolve, &file).ok());
  ASSERT_EQ(file.solves.size(), 1u);
  EXPECT_TRUE(file.solves[0].usable);
  EXPECT_LT(file.solves[0].final_cost, 0.1 * file.solves[0].initial_cost);
}

TEST(LivingRun, AStepThatCannotBeAddedIsNamed) {
  ReplayScript script;
  script.steps.resize(2);
  script.steps[0].variables.resize(1);
  script.steps[0].factors.push_back(
      {DiagonalPriorFamily::Measurement{{1.0, 2.0, 3.0}, {1.0, 1.0, 1.0}}, {0}, {}});
  script.steps[1].variables.resize(1);
  script.steps[1].factors.push_back(
      {DiagonalPriorFamily::Measurement{{1.0, 2.0}, {1.0, 1.0}}, {1}, {}});
  ReplaySettings settings;
  settings.autodiff = true;
  for (const LivingMode mode : {LivingMode::kPlain, LivingMode::kRebuild}) {
    LivingReport report;
    const Status status = PlayLiving(script, 0, settings, mode, PlainCeresSolve, &report);
    EXPECT_EQ(status.message, "step 2: factor 0 of the step: it has no AutoDiff version");
    EXPECT_EQ(report.solves.size(), 1u);
  }
}

TEST(LivingRun, ReportInJson) {
  LivingReport report;
  report.solves.resize(3);
  for (std::size_t i = 0; i < 3; ++i) {
    report.solves[i].seconds = 0.001 * static_cast<double>(i + 1);
    report.solves[i].final_cost = static_cast<double>(10 * i + 1);
  }
  report.total_seconds = 0.5;
  const nlohmann::json json = ToJson(report);
  EXPECT_EQ(json["solves"].size(), 3u);
  EXPECT_EQ(json["solves"][2]["step"], 3);
  EXPECT_EQ(json["solves"][2]["cost"], 21.0);
  EXPECT_DOUBLE_EQ(json["solve_ms"]["median"].get<double>(), 2.0);
  EXPECT_DOUBLE_EQ(json["solve_ms"]["total"].get<double>(), 6.0);
  EXPECT_EQ(json["final_cost"], 21.0);
  EXPECT_EQ(json["final_cost_sum"], 33.0);
  EXPECT_EQ(json["total_s"], 0.5);
}

TEST(LivingRun, LinearSolversByName) {
  ceres::LinearSolverType type = ceres::CGNR;
  ASSERT_TRUE(ParseReplayLinearSolver("--x", "auto", true, &type).ok());
  EXPECT_EQ(type, ceres::DENSE_SCHUR);
  ASSERT_TRUE(ParseReplayLinearSolver("--x", "auto", false, &type).ok());
  EXPECT_EQ(type, ceres::SPARSE_NORMAL_CHOLESKY);
  ASSERT_TRUE(ParseReplayLinearSolver("--x", "sparse_schur", false, &type).ok());
  EXPECT_EQ(type, ceres::SPARSE_SCHUR);
  const Status status = ParseReplayLinearSolver("--x", "magic", true, &type);
  EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
  EXPECT_EQ(status.message,
            "--x 'magic': use one of auto, dense_schur, sparse_schur, sparse_normal_cholesky");
  EXPECT_EQ(type, ceres::SPARSE_SCHUR);
}

}  // namespace
}  // namespace inceres::tools
