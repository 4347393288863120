// Both estimators on a whole run with inceres: the trajectory is as good as with stock Ceres.

#include <algorithm>
#include <memory>

#include <gtest/gtest.h>

#include "inceres/ceres/session.h"
#include "inceres/ceres/solve.h"
#include "okvis/okvis_run.h"
#include "sliding_window/estimators.h"
#include "sliding_window/scale.h"
#include "vins/vins_run.h"

namespace sliding_window {
namespace {

RunOptions Options(bool free_extrinsics) {
  RunOptions options;
  options.num_frames = kNumFramesOfRun;
  options.estimator.free_extrinsics = free_extrinsics;
  return options;
}

SolveFunction SolveBy(inceres::SolveMode mode) {
  return [mode](const ceres::Solver::Options& options, ceres::Problem* problem,
                ceres::Solver::Summary* summary) {
    inceres::SolveOptions asked;
    inceres::SolveReport report;
    asked.mode = mode;
    asked.strict = true;
    inceres::Solve(options, problem, summary, asked, &report);
    EXPECT_TRUE(summary->IsSolutionUsable()) << summary->message;
  };
}

SolveFunction SolveBySession() {
  auto session = std::make_shared<inceres::CeresSession>();
  return [session](const ceres::Solver::Options& options, ceres::Problem* problem,
                   ceres::Solver::Summary* summary) {
    inceres::SolveOptions asked;
    inceres::SolveReport report;
    asked.strict = true;
    session->Solve(options, problem, summary, asked, &report);
    EXPECT_TRUE(summary->IsSolutionUsable()) << summary->message;
  };
}

void SolveToMinimumWithStock(const ceres::Solver::Options& options, ceres::Problem* problem,
                             ceres::Solver::Summary* summary) {
  ceres::Solver::Options to_the_end = options;
  to_the_end.max_num_iterations = 50;
  to_the_end.function_tolerance = to_the_end.parameter_tolerance = 1e-12;
  ceres::Solve(to_the_end, problem, summary);
}

using Play = std::function<RunReport(const SolveFunction&)>;

constexpr double kAteTolerance = 0.01;

// Within the tolerance of where stock ends with the iterations of the estimator, or of any place
// between that and its minimum.
void ExpectAsGoodAsStock(const Play& play, const SolveFunction& ours, std::size_t num_solves,
                         double tolerance = kAteTolerance, bool to_minimum = false) {
  const RunReport stock = play(SolveWithStock);
  const RunReport report = play(ours);
  EXPECT_EQ(stock.solve_ms.size(), num_solves);
  EXPECT_EQ(report.solve_ms.size(), num_solves);
  EXPECT_LT(stock.ate_m, 0.25);  // the estimator itself does its work
  const double minimum_ate_m = to_minimum ? play(SolveToMinimumWithStock).ate_m : stock.ate_m;
  EXPECT_LT(report.ate_m, (1.0 + tolerance) * std::max(stock.ate_m, minimum_ate_m));
  EXPECT_GT(report.ate_m, (1.0 - tolerance) * std::min(stock.ate_m, minimum_ate_m));
}

Play Vins(bool free_extrinsics) {
  return [=](const SolveFunction& solve) { return RunVins(Options(free_extrinsics), solve); };
}

Play Okvis(bool free_extrinsics, bool newest_first) {
  return [=](const SolveFunction& solve) {
    OkvisOptions okvis_options;
    okvis_options.newest_first = newest_first;
    return RunOkvis(Options(free_extrinsics), okvis_options, solve);
  };
}

TEST(FreeRunning, VinsExact) {
  ExpectAsGoodAsStock(Vins(false), SolveBy(inceres::SolveMode::kExact), kNumFramesOfRun - 10);
}
TEST(FreeRunning, VinsExactExtrinsicsFree) {
  ExpectAsGoodAsStock(Vins(true), SolveBy(inceres::SolveMode::kExact), kNumFramesOfRun - 10);
}
TEST(FreeRunning, VinsIncremental) {
  ExpectAsGoodAsStock(Vins(false), SolveBy(inceres::SolveMode::kIncremental), kNumFramesOfRun - 10,
                      kAteToleranceOfOtherSteps);
}
TEST(FreeRunning, OkvisExact) {
  ExpectAsGoodAsStock(Okvis(false, false), SolveBy(inceres::SolveMode::kExact), kNumFramesOfRun);
}
TEST(FreeRunning, OkvisSession) {
  ExpectAsGoodAsStock(Okvis(false, false), SolveBySession(), kNumFramesOfRun,
                      kAteToleranceOfOtherSteps);
}
TEST(FreeRunning, OkvisSessionConstantsToggled) {
  ExpectAsGoodAsStock(Okvis(false, true), SolveBySession(), 2 * kNumFramesOfRun,
                      kAteToleranceOfOtherSteps, /*to_minimum=*/true);
}

}  // namespace
}  // namespace sliding_window
