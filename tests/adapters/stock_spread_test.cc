// What stock's own linear solvers differ by, and what the cross-check makes of it.
#include <cmath>
#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "adapters/captured_log.h"
#include "adapters/ceres/compare/compare_solves.h"
#include "adapters/ceres/compare/second_opinion.h"
#include "adapters/test_problems.h"
#include "adapters/two_faced_problem.h"
#include "inceres/ceres/cross_check.h"
#include "inceres/ceres/session.h"
#include "inceres/ceres/solve.h"

namespace inceres {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::MakeBundle;
using ::testing::Not;
using testing::TestProblem;

using Options = ceres::Solver::Options;
using CeresSummary = ceres::Solver::Summary;

constexpr int kSize = 8;

// Rows of a Hilbert matrix, bent a little: its normal equations lose most digits. `offset` is added
// by whoever plays a fault.
ceres::CostFunction* HilbertCost(int seed, const double* offset) {
  std::mt19937 random(static_cast<unsigned>(seed));
  std::vector<double> targets(2 * kSize);
  for (double& target : targets) {
    target = std::uniform_real_distribution<double>(-1.0, 1.0)(random);
  }
  return new lambdas::Formula(2 * kSize, {kSize},
                              [=](double const* const* parameters, double* residuals, double** J) {
                                for (int i = 0; i < 2 * kSize; ++i) {
                                  residuals[i] = *offset - targets[static_cast<std::size_t>(i)];
                                  for (int j = 0; j < kSize; ++j) {
                                    const double x = parameters[0][j];
                                    residuals[i] += (x + 0.1 * std::sin(x)) / (i + j + 1);
                                    J[0][i * kSize + j] = (1.0 + 0.1 * std::cos(x)) / (i + j + 1);
                                  }
                                }
                                return true;
                              });
}

std::unique_ptr<TestProblem> MakeHilbert(int seed, const double* offset) {
  auto test = std::make_unique<TestProblem>();
  test->problem.AddResidualBlock(HilbertCost(seed, offset), nullptr,
                                 test->Add(std::vector<double>(kSize, 0.1)));
  return test;
}

Options Sensitive() {
  Options options;
  options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
  options.initial_trust_region_radius = 1e12;
  options.logging_type = ceres::SILENT;
  return options;
}

std::shared_ptr<const CrossCheckResult> Checked(const Options& options, ceres::Problem* problem,
                                                double spread_factor) {
  SolveOptions asked;
  SolveReport report;
  asked.cross_check.enabled = true;
  asked.cross_check.spread_factor = spread_factor;
  CeresSummary summary;
  inceres::Solve(options, problem, &summary, asked, &report);
  EXPECT_TRUE(report.comparison->compared) << report.comparison->reason;
  return report.comparison;
}

TEST(StockSpread, WhatRoundingIsBlownUpToIsNoViolation) {
  const double offset = 0.0;
  int num_accused_at_once = 0;
  int num_accused = 0;
  for (int seed = 0; seed < 40; ++seed) {
    const auto at_once = Checked(Sensitive(), &MakeHilbert(seed, &offset)->problem, 0.0);
    EXPECT_FALSE(at_once->spread);
    num_accused_at_once += at_once->agrees() ? 0 : 1;
    const testing::CapturedLog log(google::GLOG_INFO);
    const auto result = Checked(Sensitive(), &MakeHilbert(seed, &offset)->problem,
                                CrossCheckOptions().spread_factor);
    num_accused += result->agrees() ? 0 : 1;
    EXPECT_EQ(result->spread.has_value(), !at_once->agrees());
    if (result->agrees() && !at_once->agrees()) {
      EXPECT_EQ(result->within_spread.size(), at_once->violations.size());
      EXPECT_EQ(result->first_different_iteration, -1);
      EXPECT_THAT(result->spread->linear_solvers,
                  HasSubstr("DENSE_NORMAL_CHOLESKY, SPARSE_NORMAL_CHOLESKY"));
      ASSERT_THAT(log.messages(), Not(IsEmpty()));
      EXPECT_THAT(log.messages().back(), HasSubstr("no more than stock's own linear solvers do"));
    }
  }
  EXPECT_GE(num_accused_at_once, 30);
  EXPECT_LE(
      num_accused,
      // where stock's solvers happen to end close to each other; one in twelve of 1,000 problems
      10);
}

// The same problems, of which stock is given others.
TEST(StockSpread, AViolationAmongThemIsReported) {
  for (int seed = 0; seed < 10; ++seed) {
    double offset = 0.0;
    testing::TwoFacedProblem faced([&](int solve, int, double*) {
      offset = solve >= 2 && solve <= 4 ? 1e-2 : 0.0;
      return true;
    });
    faced.test->problem.AddResidualBlock(HilbertCost(seed, &offset), nullptr,
                                         faced.test->Add(std::vector<double>(kSize, 0.1)));
    const testing::CapturedLog log;
    const auto result =
        Checked(Sensitive(), &faced.test->problem, CrossCheckOptions().spread_factor);
    EXPECT_FALSE(result->agrees());
    EXPECT_THAT(result->within_spread, IsEmpty());
    ASSERT_THAT(log.messages(), Not(IsEmpty()));
    EXPECT_THAT(log.messages().back(),
                HasSubstr("stock's own linear solvers (DENSE_NORMAL_CHOLESKY, "));
  }
}

// As a preintegration that is integrated again where the bias has moved too far: what it was
// integrated at stays.
ceres::CostFunction* RememberingCost() {
  return new lambdas::Formula(
      1, {1},
      [center = 0.0](double const* const* x, double* residuals, double** jacobians) mutable {
        if (std::abs(x[0][0] - center) > 0.5) {
          center = x[0][0];
        }
        residuals[0] = std::sin(center) + std::cos(center) * (x[0][0] - center) - 0.9;
        jacobians[0][0] = std::cos(center);
        return true;
      });
}

TEST(StockSpread, CostFunctionsThatRememberAreNotHeldAgainstUs) {
  const auto make = [](double* x) {
    auto problem = std::make_unique<ceres::Problem>();
    problem->AddResidualBlock(RememberingCost(), nullptr, x);
    problem->AddResidualBlock(new testing::TargetCost({2.0}), nullptr, x);
    return problem;
  };
  Options options;
  options.logging_type = ceres::SILENT;
  double x = 0.2;
  EXPECT_FALSE(Checked(options, make(&x).get(), 0.0)->agrees());
  const double ours = x;
  x = 0.2;
  const auto result = Checked(options, make(&x).get(), 10.0);
  EXPECT_TRUE(result->agrees()) << ::testing::PrintToString(result->violations);
  EXPECT_THAT(result->within_spread, Not(IsEmpty()));
  EXPECT_THAT(result->reason, HasSubstr("the cost functions remember"));
  EXPECT_THAT(internal::DescribeExcuse(*result), HasSubstr("but the cost functions remember"));
  EXPECT_EQ(x, ours);
}

// The end is not judged for another reason, which is told, too.
TEST(StockSpread, TheLogNamesWhatHasExcusedADifference) {
  CrossCheckResult result;
  result.within_spread = {"cost of iteration 3"};
  result.reason = "the time limit ended a solve: its end was not judged";
  EXPECT_THAT(internal::DescribeExcuse(result),
              AllOf(HasSubstr("differ, but no more than stock's own linear solvers do\n"),
                    HasSubstr("\n  the time limit ended a solve: its end was not judged\n")));
}

// The caller's callbacks and memory know of one solve only.
TEST(StockSpread, NobodyNoticesTheMeasurement) {
  const double offset = 0.0;
  for (int seed = 0; seed < 5; ++seed) {
    const auto plain = MakeHilbert(seed, &offset);
    const auto checked = MakeHilbert(seed, &offset);
    CeresSummary summary;
    inceres::Solve(Sensitive(), &plain->problem, &summary);
    testing::Recorder counter(checked.get());
    Options options = Sensitive();
    options.callbacks.push_back(&counter);
    // too little: everything is tried
    const auto result = Checked(options, &checked->problem, 1e-3);
    EXPECT_EQ(counter.iterations.size(), result->ours.iterations.size());
    EXPECT_EQ(checked->blocks, plain->blocks);
    EXPECT_EQ(result->ours.final_cost, summary.final_cost);
  }
}

TEST(StockSpread, ASampleIsMeasuredWithoutBeingAskedFor) {
  SolveOptions asked;
  SolveReport report;
  asked.cross_check.enabled = true;
  asked.cross_check.spread_interval = 4;
  int num_measured = 0;
  for (int k = 0; k < 8; ++k) {
    const auto test = MakeBundle(3, 20, true);
    Options options;
    options.linear_solver_type = ceres::DENSE_SCHUR;
    CeresSummary summary;
    inceres::Solve(options, &test->problem, &summary, asked, &report);
    EXPECT_TRUE(report.comparison->agrees());
    EXPECT_THAT(report.comparison->within_spread, IsEmpty());
    num_measured += report.comparison->spread.has_value() ? 1 : 0;
  }
  EXPECT_EQ(num_measured, 2);
}

TEST(StockSpread, ATwistedFactorIsNamed) {
  CrossCheckOptions check;
  check.spread_factor = -1.0;
  EXPECT_THAT(check.Validate().message, HasSubstr("spread_factor"));
  check.spread_factor = std::nan("");
  EXPECT_THAT(check.Validate().message, HasSubstr("spread_factor"));
  check = CrossCheckOptions();
  check.spread_interval = -1;
  EXPECT_THAT(check.Validate().message, HasSubstr("spread_interval"));
}

struct OrderedBundle {
  explicit OrderedBundle(bool ordered) : test(MakeBundle(4, 30, true)) {
    if (ordered) {
      ordering = std::make_shared<ceres::ParameterBlockOrdering>();
      for (std::vector<double>& block : test->blocks) {
        ordering->AddElementToGroup(block.data(), block.size() == 3 ? 0 : 1);
      }
    }
  }
  CeresSummary SolveWith(Options options) {
    options.linear_solver_ordering = options.linear_solver_ordering == nullptr ? nullptr : ordering;
    CeresSummary summary;
    ceres::Solve(options, &test->problem, &summary);
    EXPECT_TRUE(summary.IsSolutionUsable()) << summary.message;
    return summary;
  }
  std::unique_ptr<TestProblem> test;
  std::shared_ptr<ceres::ParameterBlockOrdering> ordering;
};

// Stock takes blocks that are constant out of the orderings it is given, and writes its dumps.
TEST(StockSpread, AQuietSolveLeavesTheCallersOrderingsAndFilesAlone) {
  const OrderedBundle bundle(/*ordered=*/true);
  Options options;
  options.linear_solver_ordering = options.inner_iteration_ordering = bundle.ordering;
  options.trust_region_minimizer_iterations_to_dump = {0, 1};
  const Options quiet = internal::QuietOptions(options);
  EXPECT_NE(quiet.linear_solver_ordering, bundle.ordering);
  EXPECT_NE(quiet.inner_iteration_ordering, bundle.ordering);
  EXPECT_EQ(quiet.inner_iteration_ordering->NumElements(), bundle.ordering->NumElements());
  EXPECT_THAT(quiet.trust_region_minimizer_iterations_to_dump, IsEmpty());
}

// Whatever was asked for, with an ordering or without: the others solve the same problem.
TEST(StockSpread, OtherLinearSolversComeToTheSameEnd) {
  for (const auto type :
       {ceres::DENSE_SCHUR, ceres::SPARSE_SCHUR, ceres::DENSE_NORMAL_CHOLESKY,
        ceres::SPARSE_NORMAL_CHOLESKY, ceres::DENSE_QR, ceres::ITERATIVE_SCHUR, ceres::CGNR}) {
    for (const bool ordered : {false, true}) {
      OrderedBundle bundle(ordered);
      Options options;
      options.linear_solver_type = type;
      options.linear_solver_ordering = bundle.ordering;
      options.function_tolerance = 1e-12;
      options.max_num_iterations = 200;
      options.logging_type = ceres::SILENT;
      const CeresSummary summary = bundle.SolveWith(options);
      const auto others = internal::OtherLinearSolvers(options, summary);
      EXPECT_EQ(others.empty(),
                type == ceres::DENSE_QR &&
                    !ceres::IsDenseLinearAlgebraLibraryTypeAvailable(ceres::LAPACK));
      for (const Options& other : others) {
        const CeresSummary end = OrderedBundle(ordered).SolveWith(other);
        EXPECT_NEAR(end.final_cost, summary.final_cost, 1e-6 * summary.final_cost)
            << ceres::LinearSolverTypeToString(type);
      }
    }
  }
}

}  // namespace
}  // namespace inceres
