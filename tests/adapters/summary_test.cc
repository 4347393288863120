// Every field of the summary against stock Ceres.
#include <gtest/gtest.h>

#include "adapters/compare_with_stock.h"
#include "support/ceres_manifolds.h"

namespace inceres {
namespace {

using testing::BothSolved;
using testing::ExpectSameParameters;
using testing::ExpectSameSummary;
using testing::MakeBundle;
using testing::MakeClosedCurve;
using testing::MakeCurveFit;
using testing::MakePowell;
using testing::MakeWindow;
using testing::SolveBoth;
using testing::TestProblem;

ceres::Solver::Options WithSolver(
    ceres::LinearSolverType type,
    ceres::TrustRegionStrategyType strategy = ceres::LEVENBERG_MARQUARDT) {
  ceres::Solver::Options options;
  options.linear_solver_type = type;
  options.trust_region_strategy_type = strategy;
  return options;
}

// The rule of counts in docs/ceres_contract.md, "Summary fields"; for Levenberg–Marquardt only.
void ExpectCountIdentities(const ceres::Solver::Summary& summary) {
  int num_invalid = 0;
  for (const ceres::IterationSummary& iteration : summary.iterations) {
    num_invalid += iteration.step_is_valid ? 0 : 1;
  }
  const bool by_tolerance = summary.message.rfind("Function tolerance", 0) == 0 ||
                            summary.message.rfind("Parameter tolerance", 0) == 0;
  const int S = summary.num_successful_steps;
  const int U = summary.num_unsuccessful_steps;
  EXPECT_EQ(S + U, static_cast<int>(summary.iterations.size()));
  EXPECT_EQ(summary.num_jacobian_evaluations, S);
  EXPECT_EQ(summary.num_residual_evaluations, S - 1 + U - num_invalid + by_tolerance);
  EXPECT_EQ(summary.num_linear_solves, S - 1 + U + by_tolerance);
}

TEST(Summary, Powell) {
  for (const auto strategy : {ceres::LEVENBERG_MARQUARDT, ceres::DOGLEG}) {
    const BothSolved both = SolveBoth(MakePowell, WithSolver(ceres::DENSE_QR, strategy));
    ExpectSameSummary(both, 1e-9, true);
    ExpectSameParameters(both, 1e-9);
  }
}

TEST(Summary, CurveFitWithAndWithoutLoss) {
  for (const double width : {0.0, 0.5}) {
    for (const auto strategy : {ceres::LEVENBERG_MARQUARDT, ceres::DOGLEG}) {
      const BothSolved both =
          SolveBoth([&] { return MakeCurveFit(width); }, WithSolver(ceres::DENSE_QR, strategy));
      ExpectSameSummary(both, 1e-9, true);
      ExpectSameParameters(both, 1e-9);
      EXPECT_EQ(both.report.num_landmarks, 0);
    }
  }
}

#ifdef CERES_RESTRICT_SCHUR_SPECIALIZATION
constexpr const char* kBundleStructure = "d,d,d";
#else
constexpr const char* kBundleStructure = "2,3,9";
#endif

TEST(Summary, Bundle) {
  const auto recipe = [] { return MakeBundle(6, 60, true); };
  for (const auto type : {ceres::DENSE_SCHUR, ceres::SPARSE_SCHUR}) {
    const BothSolved both = SolveBoth(recipe, WithSolver(type));
    ExpectSameSummary(both, 1e-9, true);
    ExpectSameParameters(both, 1e-5);
    EXPECT_EQ(both.ours.schur_structure_used, kBundleStructure);
    EXPECT_EQ(both.report.num_landmarks, 60);
    EXPECT_EQ(both.report.num_frames, 5);
    EXPECT_EQ(both.report.core.iterations.size(), both.ours.iterations.size());
    ExpectCountIdentities(both.ours);
  }
}

TEST(Summary, BundleWithUsersOrdering) {
  const auto order = [](TestProblem* test, ceres::Solver::Options* options) {
    options->linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    for (auto& block : test->blocks) {
      options->linear_solver_ordering->AddElementToGroup(block.data(), block.size() == 3 ? 3 : 7);
    }
  };
  for (const auto type : {ceres::DENSE_SCHUR, ceres::SPARSE_SCHUR, ceres::SPARSE_NORMAL_CHOLESKY}) {
    const BothSolved both =
        SolveBoth([] { return MakeBundle(6, 60, true); }, WithSolver(type), order);
    ExpectSameSummary(both, 1e-9, true);
    EXPECT_EQ(both.report.num_landmarks, 60);
    EXPECT_EQ(both.ours.linear_solver_ordering_given, (std::vector<int>{60, 6}))
        << "before any removal";
    EXPECT_EQ(both.ours.linear_solver_ordering_used, (std::vector<int>{60, 5}));
  }
}

// Constants empty the first group: Ceres switches to a solver without elimination.
TEST(Summary, EmptiedFirstGroupSwitchesTheLinearSolver) {
  const auto order = [](TestProblem* test, ceres::Solver::Options* options) {
    options->linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    for (auto& block : test->blocks) {
      options->linear_solver_ordering->AddElementToGroup(block.data(), block.size() == 3 ? 0 : 1);
      if (block.size() == 3) {
        test->problem.SetParameterBlockConstant(block.data());
      }
    }
  };
  const BothSolved dense =
      SolveBoth([] { return MakeBundle(3, 20, true); }, WithSolver(ceres::DENSE_SCHUR), order);
  ExpectSameSummary(dense, 1e-9, true);
  EXPECT_EQ(dense.ours.linear_solver_type_used, ceres::DENSE_QR);
  const BothSolved sparse =
      SolveBoth([] { return MakeBundle(3, 20, true); }, WithSolver(ceres::SPARSE_SCHUR), order);
  ExpectSameSummary(sparse, 1e-9, true);
  EXPECT_EQ(sparse.ours.linear_solver_type_used, ceres::SPARSE_NORMAL_CHOLESKY);
}

TEST(Summary, WindowWithLocalParameterizationsConstantsAndFixedCost) {
  for (const auto strategy : {ceres::LEVENBERG_MARQUARDT, ceres::DOGLEG}) {
    for (const auto type :
         {ceres::DENSE_SCHUR, ceres::SPARSE_NORMAL_CHOLESKY, ceres::DENSE_NORMAL_CHOLESKY}) {
      const BothSolved both =
          SolveBoth([] { return MakeWindow(5, 30, true); }, WithSolver(type, strategy));
      ExpectSameSummary(both, 1e-8, false);
      ExpectSameParameters(both, 1e-6);
      EXPECT_GT(both.ours.fixed_cost, 0.0);
      EXPECT_EQ(both.report.num_landmarks, 30);
    }
  }
}

// Constant cameras: every block is a landmark and the reduced system is empty.
TEST(Summary, OnlyLandmarks) {
  const auto recipe = [] {
    auto test = MakeBundle(6, 40, true);
    for (std::size_t c = 0; c < 6; ++c) {
      test->problem.SetParameterBlockConstant(test->blocks[c].data());
    }
    return test;
  };
  const BothSolved both = SolveBoth(recipe, WithSolver(ceres::DENSE_SCHUR));
  ExpectSameSummary(both, 1e-9, true);
  ExpectSameParameters(both, 1e-8);
  EXPECT_EQ(both.report.num_landmarks, 40);
  EXPECT_EQ(both.report.num_frames, 0);
}

// Residual blocks that touch all control points of a curve, of which three count.
TEST(Summary, DynamicSparsityOfOneAndTwoThreads) {
  ceres::Solver::Options options = WithSolver(ceres::SPARSE_NORMAL_CHOLESKY);
  options.dynamic_sparsity = true;
  options.max_num_iterations = 10;
  for (const unsigned seed : {1U, 2U}) {
    const BothSolved both = SolveBoth([=] { return MakeClosedCurve(seed, seed == 2); }, options);
    EXPECT_FALSE(both.report.used_stock) << both.report.fallback_reason;
    ExpectSameSummary(both, 1e-7, true);
    ExpectSameParameters(both, 1e-5);
    EXPECT_TRUE(both.report.options_without_effect.empty());
    EXPECT_EQ(both.report.num_landmarks, 0);
    EXPECT_GT(both.ours.iterations.size(), 4U);
  }
  // Where no block is zero.
  ExpectSameSummary(SolveBoth([] { return MakeBundle(4, 25, true); }, options), 1e-7, true);
  options.trust_region_strategy_type = ceres::DOGLEG;
  options.num_threads = 2;
  ExpectSameSummary(SolveBoth([] { return MakeClosedCurve(4, false); }, options), 1e-6, true);
}

TEST(Summary, SchurTypeWithoutLandmarks) {
  const BothSolved both = SolveBoth([] { return MakeWindow(5, 0, false); },
                                    WithSolver(ceres::DENSE_SCHUR, ceres::DOGLEG));
  ExpectSameSummary(both, 1e-8, false);
  ExpectSameParameters(both, 1e-6);
  EXPECT_EQ(both.report.num_landmarks, 0);
}

TEST(Summary, ResultDoesNotDependOnThreads) {
  std::deque<std::vector<double>> results[2];
  for (const int num_threads : {1, 2}) {
    ceres::Solver::Options options = WithSolver(ceres::DENSE_SCHUR);
    options.num_threads = num_threads;
    const auto test = MakeWindow(6, 200, true);
    ceres::Solver::Summary summary;
    inceres::Solve(options, &test->problem, &summary);
    EXPECT_TRUE(summary.IsSolutionUsable()) << summary.message;
    results[num_threads - 1] = test->blocks;
  }
  EXPECT_EQ(results[0], results[1]) << "to the last bit";
}

TEST(Summary, RejectedAndNonmonotonicSteps) {
  ceres::Solver::Options options = WithSolver(ceres::DENSE_QR);
  options.initial_trust_region_radius = 1e10;  // the first steps overshoot
  for (const bool nonmonotonic : {false, true}) {
    options.use_nonmonotonic_steps = nonmonotonic;
    const BothSolved both = SolveBoth([] { return MakeCurveFit(0.0); }, options);
    ExpectSameSummary(both, 1e-9, true);
    EXPECT_GT(both.ours.num_unsuccessful_steps, 0);
    ExpectCountIdentities(both.ours);
  }
}

// Up to its times the long report is Ceres's, character by character.
TEST(Summary, Reports) {
  const auto up_to_times = [](const std::string& report) {
    return report.substr(0, report.find("Time (in seconds)"));
  };
  const auto without_change = [](std::string report) {
    const std::size_t change = report.find("Change");
    return change == std::string::npos ? report : report.erase(change, 40);
  };
  const auto with_manifold = [](TestProblem* test, ceres::Solver::Options*) {
    manifolds::Set(&test->problem, test->blocks[1].data(), new manifolds::SubsetManifold(9, {6}));
  };
  const auto bounded = [](TestProblem* test, ceres::Solver::Options*) {
    test->problem.SetParameterUpperBound(test->blocks[1].data(), 0, 100.0);
  };
  const auto failing = [](TestProblem* test, ceres::Solver::Options*) {
    test->problem.AddResidualBlock(new testing::ShapeOnlyCost(1, {9}), nullptr,
                                   test->blocks[1].data());
  };
  for (const testing::Adjust& adjust : {testing::Adjust(nullptr), testing::Adjust(with_manifold),
                                        testing::Adjust(bounded), testing::Adjust(failing)}) {
    const BothSolved both =
        SolveBoth([] { return MakeBundle(6, 60, true); }, WithSolver(ceres::DENSE_SCHUR), adjust);
    EXPECT_EQ(both.ours.BriefReport(), both.stock.BriefReport());
    EXPECT_EQ(without_change(up_to_times(both.ours.FullReport())),
              without_change(up_to_times(both.stock.FullReport())));
  }
}

}  // namespace
}  // namespace inceres
