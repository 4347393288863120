// A problem that is built anew every frame: a structure met before is found again by content, and
// no number of an earlier solve survives.
#include <cmath>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "adapters/test_problems.h"
#include "inceres/ceres/solve.h"
#include "support/ceres_manifolds.h"

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
  SolveOptions asked;
  SolveReport report;
  asked.strict = true;
  Solve(options, &test->problem, &summary, asked, &report);
  EXPECT_TRUE(summary.IsSolutionUsable()) << summary.message << report.fallback_reason;
  return {
      report.core.structure_reused, summary.final_cost, {test->blocks.begin(), test->blocks.end()}};
}

class RebuiltProblem : public ::testing::Test {
 protected:
  RebuiltProblem() { ForgetStructures(); }
  ~RebuiltProblem() override { ForgetStructures(); }
};

TEST_F(RebuiltProblem, FindsItsStructureAndHasTheBitsOfTheFirst) {
  const std::vector<Recipe> recipes = {[] { return MakePowell(); },
                                       [] { return MakeCurveFit(0.5); },
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
      test.problem.AddResidualBlock(new testing::TargetCost({1.0 * i, 0.0, 1.0}), new Loss(fails),
                                    a);
    }
    test.problem.AddResidualBlock(new testing::TargetCost({2.0}), nullptr, b);
    ceres::Solver::Options options;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    SolveReport report;
    Solve(options, &test.problem, &summary, {}, &report);
    EXPECT_FALSE(report.used_stock) << report.fallback_reason;
    return b[0];
  };
  solve(true);
  EXPECT_NEAR(solve(false), 2.0, 1e-3);
}

// Ways in which problems of the same few blocks and residual blocks can differ, one at a time.
struct StructureDifference {
  bool constant = false;
  bool manifold = false;
  bool bounds = false;
  bool loss = false;
  bool swapped_slots = false;
  bool other_neighbor = false;
  bool more_residuals = false;
  bool longer_block = false;
  bool fixed_residual_block = false;
  std::vector<std::size_t> first_group;
  bool qr = false;
  double shift = 0.0;
};

// r = (weighted sum of all entries) − target in each row, with other weights for other targets,
// rows and places.
ceres::CostFunction* SumCost(int num_residuals, const std::vector<int>& sizes, double target) {
  return new lambdas::Formula(
      num_residuals, sizes, [=](double const* const* x, double* residuals, double** jacobians) {
        for (int row = 0; row < num_residuals; ++row) {
          residuals[row] = -target;
          for (std::size_t s = 0; s < sizes.size(); ++s) {
            for (int k = 0; k < sizes[s]; ++k) {
              const double weight =
                  1.0 + std::sin(target + 3.0 * row + 5.0 * static_cast<double>(s) + k);
              residuals[row] += weight * x[s][k];
              jacobians[s][row * sizes[s] + k] = weight;
            }
          }
        }
        return true;
      });
}

// Blocks lie in one array, so that their order by address is the same each time, and are touched by
// chains of residual blocks.
std::vector<double> SolveWith(const StructureDifference& difference) {
  std::vector<double> memory(10, 0.3);
  const std::vector<int> sizes = {2, 2, difference.longer_block ? 4 : 3};
  const std::vector<double*> blocks = {memory.data(), memory.data() + 2, memory.data() + 4};
  ceres::Problem problem;
  const int num_residuals = difference.more_residuals ? 2 : 1;
  for (int i = 0; i < 12; ++i) {
    std::size_t a = 0;
    std::size_t b = i % 2 == 0 ? 1 : 2;
    if (difference.other_neighbor && i == 7) {
      b = 1;
    }
    if (difference.swapped_slots && i > 4) {
      std::swap(a, b);
    }
    problem.AddResidualBlock(
        SumCost(num_residuals, {sizes[a], sizes[b]}, 0.1 * i + difference.shift),
        difference.loss && i % 3 == 0 ? new ceres::CauchyLoss(0.5) : nullptr, blocks[a], blocks[b]);
  }
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    problem.AddResidualBlock(SumCost(sizes[b], {sizes[b]}, 1.0), nullptr, blocks[b]);
  }
  if (difference.fixed_residual_block) {
    double* const alone = memory.data() + 9;
    problem.AddResidualBlock(SumCost(1, {1}, 2.0), nullptr, alone);
    problem.SetParameterBlockConstant(alone);
  }
  if (difference.constant) {
    problem.SetParameterBlockConstant(blocks[1]);
  }
  if (difference.manifold) {
    manifolds::Set(&problem, blocks[0], new manifolds::SubsetManifold(2, {1}));
  }
  if (difference.bounds) {
    problem.SetParameterUpperBound(blocks[1], 0, 0.31);
  }
  ceres::Solver::Options options;
  options.logging_type = ceres::SILENT;
  options.linear_solver_type = difference.qr ? ceres::DENSE_QR : ceres::DENSE_SCHUR;
  if (!difference.first_group.empty()) {
    options.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    for (double* const block : blocks) {
      options.linear_solver_ordering->AddElementToGroup(block, 1);
    }
    for (const std::size_t b : difference.first_group) {
      options.linear_solver_ordering->AddElementToGroup(blocks[b], 0);
    }
  }
  ceres::Solver::Summary summary;
  SolveReport report;
  Solve(options, &problem, &summary, {}, &report);
  EXPECT_FALSE(report.used_stock) << report.fallback_reason;
  EXPECT_TRUE(summary.IsSolutionUsable()) << summary.message;
  memory.push_back(summary.final_cost);
  memory.push_back(report.num_landmarks);
  return memory;
}

// What is kept of one problem must not serve another that only looks like it.
TEST_F(RebuiltProblem, HasTheBitsOfTheFirstAfterAnyOther) {
  std::vector<StructureDifference> all(14);
  all[1].constant = true;
  all[2].manifold = true;
  all[3].bounds = true;
  all[4].loss = true;
  all[5].swapped_slots = true;
  all[6].other_neighbor = true;
  all[7].more_residuals = true;
  all[8].longer_block = true;
  all[9].fixed_residual_block = true;
  all[10].first_group = {1, 2};
  all[11].qr = true;
  all[12].first_group = {1};
  all[13].shift = 0.7;
  std::vector<std::vector<double>> alone;
  for (const StructureDifference& difference : all) {
    ForgetStructures();
    alone.push_back(SolveWith(difference));
  }
  for (std::size_t before = 0; before < all.size(); ++before) {
    for (std::size_t after = 0; after < all.size(); ++after) {
      SolveWith(all[before]);
      EXPECT_EQ(SolveWith(all[after]), alone[after]) << after << " after " << before;
    }
  }
}

// A QR factorization eliminates no landmarks, where others of the same problem do.
TEST_F(RebuiltProblem, HasTheLandmarksOfItsLinearSolver) {
  // once: its blocks stay in order of address
  const std::unique_ptr<TestProblem> test = MakeBundle(6, 40, true);
  const auto num_landmarks = [&test](ceres::LinearSolverType type) {
    ceres::Solver::Options options;
    options.linear_solver_type = type;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    SolveReport report;
    Solve(options, &test->problem, &summary, {}, &report);
    EXPECT_FALSE(report.used_stock) << report.fallback_reason;
    return report.num_landmarks;
  };
  EXPECT_EQ(num_landmarks(ceres::DENSE_SCHUR), 40);
  EXPECT_EQ(num_landmarks(ceres::DENSE_QR), 0);
  EXPECT_EQ(num_landmarks(ceres::DENSE_SCHUR), 40);
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
