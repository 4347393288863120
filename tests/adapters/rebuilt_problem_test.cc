// A problem that is built anew every frame: a structure met before is found again by content, and no number of an earlier solve
// survives.
#include <cmath>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "adapters/test_problems.h"
#include "inceres/ceres/solve.h"

namespace inceres {
namespace {

using testing::MakeBundle;
using testing::MakeCurveFit;
using testing::MakePowell;
using testing::Recipe;
using testing::TestProblem;

struct Outcome {
  bool reused = false;
  double cost = 0.0;
  std::vector<std::vector<double>> values;
};

Outcome SolveNew(const Recipe& recipe, int num_threads = 1) {
  const std::unique_ptr<TestProblem> test = recipe();
  ceres::Solver::Options options;
  options.num_threads = num_threads;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  SolveReport report;
  report.strict = true;
  Solve(options, &test->problem, &summary, &report);
  EXPECT_TRUE(summary.IsSolutionUsable()) << summary.message << report.fallback_reason;
  return {report.core.structure_reused, summary.final_cost, {test->blocks.begin(), test->blocks.end()}};
}

class RebuiltProblem : public ::testing::Test {
 protected:
  RebuiltProblem() { ForgetStructures(); }
  ~RebuiltProblem() override { ForgetStructures(); }
};

TEST_F(RebuiltProblem, FindsItsStructureAndHasTheBitsOfTheFirst) {
  const std::vector<Recipe> recipes = {[] { return MakePowell(); }, [] { return MakeCurveFit(0.5); },
                                       [] { return MakeBundle(6, 40, true); }};
  for (const Recipe& recipe : recipes) {
    const Outcome first = SolveNew(recipe);
    const Outcome second = SolveNew(recipe);
    EXPECT_FALSE(first.reused);
    EXPECT_TRUE(second.reused);
    EXPECT_EQ(first.cost, second.cost);
    EXPECT_EQ(first.values, second.values);
  }
}

// A loss that is not finite spoils more of the Jacobian than the columns its residual block has.
TEST_F(RebuiltProblem, IsSolvedAfterOneWhoseLossWasNotFinite) {
  class Loss : public ceres::LossFunction {
   public:
    explicit Loss(bool fails) : fails_(fails) {}
    void Evaluate(double s, double out[3]) const override {
      out[0] = s;
      out[1] = fails_ ? std::nan("") : 1.0;
      out[2] = 0.0;
    }

   private:
    bool fails_;
  };
  const auto solve = [](bool fails) {
    TestProblem test;
    double* a = test.Add({1.0, 2.0, 3.0});
    double* b = test.Add({4.0});
    for (int i = 0; i < 10; ++i) {
      test.problem.AddResidualBlock(new testing::TargetCost({1.0 * i, 0.0, 1.0}), new Loss(fails), a);
    }
    test.problem.AddResidualBlock(new testing::TargetCost({2.0}), nullptr, b);
    ceres::Solver::Options options;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    SolveReport report;
    Solve(options, &test.problem, &summary, &report);
    EXPECT_FALSE(report.used_stock) << report.fallback_reason;
    return b[0];
  };
  solve(true);
  EXPECT_NEAR(solve(false), 2.0, 1e-3);
}

TEST_F(RebuiltProblem, OfAnotherStructureIsSetUpAnew) {
  EXPECT_FALSE(SolveNew([] { return MakeBundle(6, 40, true); }).reused);
  EXPECT_FALSE(SolveNew([] { return MakeBundle(6, 40, false); }).reused);
  EXPECT_FALSE(SolveNew([] { return MakeBundle(6, 41, true); }).reused);
  EXPECT_FALSE(SolveNew([] { return MakeBundle(6, 40, true); }, /*num_threads=*/2).reused);
  EXPECT_TRUE(SolveNew([] { return MakeBundle(6, 40, true); }).reused);
}

TEST_F(RebuiltProblem, IsForgottenOnRequestAndWhenOthersComeBetween) {
  const Recipe recipe = [] { return MakePowell(); };
  SolveNew(recipe);
  ForgetStructures();
  EXPECT_FALSE(SolveNew(recipe).reused);
  for (int num_points = 20; num_points < 24; ++num_points) {
    SolveNew([num_points] { return MakeBundle(4, num_points, true); });
  }
  EXPECT_FALSE(SolveNew(recipe).reused);
}

TEST_F(RebuiltProblem, ConcurrentSolvesTakeASolverEach) {
  const Recipe recipe = [] { return MakeBundle(6, 40, true); };
  const Outcome expected = SolveNew(recipe);
  std::vector<std::thread> threads;
  for (int t = 0; t < 3; ++t) {
    threads.emplace_back([&] {
      for (int k = 0; k < 5; ++k) {
        const Outcome outcome = SolveNew(recipe);
        EXPECT_EQ(outcome.cost, expected.cost);
        EXPECT_EQ(outcome.values, expected.values);
      }
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
}

}  // namespace
}  // namespace inceres
