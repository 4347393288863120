// What comes and goes leaves nothing behind: thousands of small problems, each of another
// structure.
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "adapters/session_support.h"
#include "adapters/test_problems.h"
#include "inceres/ceres/session.h"
#include "inceres/ceres/solve.h"
#include "support/resident_memory.h"

namespace inceres {
namespace {

using testing::TestProblem;

constexpr int kWarmUp = 500;
constexpr int kSolves = 3000;
// an arena of oneTBB that is lost in each solve is six times as much
constexpr long kMaxGrowth = 2 << 20;

// One to seven blocks of one to five values, some under a loss: what few of the last problems were.
std::unique_ptr<TestProblem> MakeProblem(int k) {
  auto test = std::make_unique<TestProblem>();
  for (int i = 0; i < 1 + k % 7; ++i) {
    const auto size = static_cast<std::size_t>(1 + (k / 7 + i) % 5);
    double* const block = test->Add(std::vector<double>(size, 0.5));
    for (int repeat = 0; repeat < 1 + k / 35 % 3; ++repeat) {
      ceres::LossFunction* const loss = k % 2 == 0 ? new ceres::HuberLoss(1.0) : nullptr;
      test->problem.AddResidualBlock(
          new testing::TargetCost(std::vector<double>(size, 0.1 * i + repeat)), loss, block);
    }
  }
  return test;
}

ceres::Solver::Options Options(int k) {
  ceres::Solver::Options options;
  options.num_threads = 2;
  options.max_num_iterations = 3;
  options.trust_region_strategy_type = k % 3 == 0 ? ceres::DOGLEG : ceres::LEVENBERG_MARQUARDT;
  options.logging_type = ceres::SILENT;
  return options;
}

template <typename Solve>
void ExpectNoGrowth(const Solve& solve) {
  if (test::kUnderSanitizer || test::ResidentBytes() < 0) {
    GTEST_SKIP() << "memory cannot be measured here";
  }
  long before = 0;
  for (int k = 0; k < kWarmUp + kSolves; ++k) {
    before = k == kWarmUp ? test::ResidentBytes() : before;
    const std::unique_ptr<TestProblem> test = MakeProblem(k);
    ceres::Solver::Summary summary;
    solve(Options(k), &test->problem, &summary);
    ASSERT_TRUE(summary.IsSolutionUsable()) << summary.message;
  }
  EXPECT_LT(test::ResidentBytes() - before, kMaxGrowth);
}

void SolveStrictly(SolveMode mode, const ceres::Solver::Options& options, ceres::Problem* problem,
                   ceres::Solver::Summary* summary) {
  SolveOptions asked;
  SolveReport report;
  asked.mode = mode;
  asked.strict = true;
  Solve(options, problem, summary, asked, &report);
}

TEST(MemoryGrowth, OfExactSolves) {
  ExpectNoGrowth([](const auto& options, auto* problem, auto* summary) {
    SolveStrictly(SolveMode::kExact, options, problem, summary);
  });
}

TEST(MemoryGrowth, OfIncrementalSolves) {
  ExpectNoGrowth([](const auto& options, auto* problem, auto* summary) {
    SolveStrictly(SolveMode::kIncremental, options, problem, summary);
  });
}

TEST(MemoryGrowth, OfSessions) {
  ExpectNoGrowth([](const auto& options, auto* problem, auto* summary) {
    CeresSession session{inceres::testing::AlwaysIncremental()};
    session.Solve(options, problem, summary);
  });
}

TEST(MemoryGrowth, OfASessionThatMeetsOtherProblems) {
  CeresSession session{inceres::testing::AlwaysIncremental()};
  ExpectNoGrowth([&](const auto& options, auto* problem, auto* summary) {
    session.Solve(options, problem, summary);
  });
}

TEST(MemoryGrowth, OfSolvesInThreadsThatEnd) {
  ExpectNoGrowth([](const auto& options, auto* problem, auto* summary) {
    std::thread([&] { SolveStrictly(SolveMode::kExact, options, problem, summary); }).join();
  });
}

}  // namespace
}  // namespace inceres
