// Bounds in exact mode next to stock Ceres: trace, counts, summary and the user's memory.
#include <cmath>
#include <limits>
#include <string>
#include <tuple>

#include <gtest/gtest.h>

#include "adapters/compare_with_stock.h"
#include "support/ceres_manifolds.h"

namespace inceres {
namespace {

using testing::BothSolved;
using testing::Recorder;
using testing::SolveBoth;
using testing::TestProblem;
using Options = ceres::Solver::Options;
using Problem = std::unique_ptr<TestProblem>;

// (10 (y − x²), exp(x − 1) − 1), Rosenbrock's valley but for the exponential: along a step
// Rosenbrock's own cost is a polynomial of degree four, and the degree five that CUBIC fits to
// three points then has a leading coefficient of rounding only, in stock as well. Cannot be
// evaluated where |x| is at least `fail_beyond`, and says so in one of two ways.
ceres::CostFunction* Valley(double fail_beyond = 1e9, bool with_nan = false) {
  return new lambdas::Formula(2, {1, 1}, [=](double const* const* v, double* r, double** J) {
    const double x = v[0][0];
    const bool fails = std::abs(x) >= fail_beyond;
    r[0] = fails && with_nan ? std::nan("") : 10.0 * (v[1][0] - x * x);
    r[1] = std::exp(x - 1.0) - 1.0;
    J[0][0] = -20.0 * x;
    J[0][1] = std::exp(x - 1.0);
    J[1][0] = 10.0;
    return !fails || with_nan;
  });
}

Problem MakeValley(double start, double lower, double upper,
                   ceres::CostFunction* valley = Valley()) {
  auto test = std::make_unique<TestProblem>();
  double* x = test->Add({start});
  double* y = test->Add({1.0});
  test->problem.AddResidualBlock(valley, nullptr, x, y);
  test->problem.SetParameterLowerBound(x, 0, lower);
  test->problem.SetParameterUpperBound(x, 0, upper);
  return test;
}

// The minimum outside the bounds.
Problem BoundedValley() {
  return MakeValley(-1.2, -2.0, 0.5);
}
// The start outside: it is projected.
Problem StartOutside() {
  return MakeValley(-9.0, -2.0, 2.0);
}
// Never reached, but the line search runs.
Problem InactiveBounds() {
  return MakeValley(-1.2, -50.0, 50.0);
}

Problem BoundedPowell() {
  auto test = testing::MakePowell();
  test->problem.SetParameterLowerBound(test->blocks[0].data(), 0, 0.7);
  test->problem.SetParameterUpperBound(test->blocks[2].data(), 0, 0.4);
  return test;
}

Problem BoundedCurve() {
  auto test = testing::MakeCurveFit(1.0);
  test->problem.SetParameterUpperBound(test->blocks[0].data(), 0, 0.25);
  test->problem.SetParameterLowerBound(test->blocks[1].data(), 0, -3.0);
  return test;
}

// Focal lengths in a band, points before a wall.
Problem BoundedBundle() {
  auto test = testing::MakeBundle(4, 25, true);
  for (auto& block : test->blocks) {
    if (block.size() == 9) {
      test->problem.SetParameterLowerBound(block.data(), 6, 499.0);
      test->problem.SetParameterUpperBound(block.data(), 6, 500.5);
    } else {
      test->problem.SetParameterUpperBound(block.data(), 2, 8.0);
    }
  }
  return test;
}

// Inverse depths kept positive; poses on a manifold with bounds on a coordinate and on an entry of
// the quaternion; velocities.
Problem BoundedWindow() {
  auto test = testing::MakeWindow(5, 25, true);
  for (auto& block : test->blocks) {
    if (block.size() == 1) {
      test->problem.SetParameterLowerBound(block.data(), 0, 0.16);
    } else if (block.size() == 9) {
      test->problem.SetParameterUpperBound(block.data(), 4, 0.12);
    } else if (block.size() == 7 && manifolds::Has(test->problem, block.data()) &&
               !test->problem.IsParameterBlockConstant(block.data())) {
      test->problem.SetParameterUpperBound(block.data(), 1, block[1] + 0.005);
      test->problem.SetParameterLowerBound(block.data(), 5, block[5] - 1e-4);
    }
  }
  return test;
}

struct BoundedCase {
  const char* name;
  Problem (*recipe)();
  ceres::LinearSolverType linear_solver;
};

using Parameters = std::tuple<BoundedCase, ceres::LineSearchInterpolationType,
                              ceres::TrustRegionStrategyType, bool>;

class Bounds : public ::testing::TestWithParam<Parameters> {};

TEST_P(Bounds, FollowStock) {
  const auto& [which, interpolation, strategy, nonmonotonic] = GetParam();
  Options options;
  options.linear_solver_type = which.linear_solver;
  options.line_search_interpolation_type = interpolation;
  options.trust_region_strategy_type = strategy;
  options.use_nonmonotonic_steps = nonmonotonic;
  options.max_num_iterations = 30;
  const BothSolved both = SolveBoth(which.recipe, options);
  EXPECT_TRUE(both.ours.is_constrained);
  ExpectSameSummary(both, 1e-7, false);
  ExpectSameParameters(both, 1e-6);
}

INSTANTIATE_TEST_SUITE_P(
    Problems, Bounds,
    ::testing::Combine(
        ::testing::Values(BoundedCase{"Valley", BoundedValley, ceres::DENSE_QR},
                          BoundedCase{"StartOutside", StartOutside, ceres::DENSE_QR},
                          BoundedCase{"Inactive", InactiveBounds, ceres::DENSE_NORMAL_CHOLESKY},
                          BoundedCase{"Powell", BoundedPowell, ceres::DENSE_QR},
                          BoundedCase{"Curve", BoundedCurve, ceres::DENSE_QR},
                          BoundedCase{"Bundle", BoundedBundle, ceres::DENSE_SCHUR},
                          BoundedCase{"Window", BoundedWindow, ceres::SPARSE_SCHUR}),
        ::testing::Values(ceres::BISECTION, ceres::QUADRATIC, ceres::CUBIC),
        ::testing::Values(ceres::LEVENBERG_MARQUARDT, ceres::DOGLEG), ::testing::Bool()),
    [](const ::testing::TestParamInfo<Parameters>& instance) {
      return std::string(std::get<0>(instance.param).name) +
             ceres::LineSearchInterpolationTypeToString(std::get<1>(instance.param)) +
             (std::get<2>(instance.param) == ceres::DOGLEG ? "Dogleg" : "") +
             (std::get<3>(instance.param) ? "Nonmonotonic" : "");
    });

// The table above is worth something only if searches take steps, and bounds are met.
TEST(BoundsDetails, TheProblemsExerciseTheSearchAndTheBounds) {
  Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  for (const auto interpolation : {ceres::BISECTION, ceres::QUADRATIC, ceres::CUBIC}) {
    options.line_search_interpolation_type = interpolation;
    const BothSolved both = SolveBoth(InactiveBounds, options);
    EXPECT_GT(both.ours.num_line_search_steps, 1);
    const int others = both.ours.num_successful_steps;
    EXPECT_EQ(both.ours.num_jacobian_evaluations > others, interpolation == ceres::CUBIC);
  }
  EXPECT_EQ(SolveBoth(BoundedValley, options).our_problem->blocks[0][0], 0.5);
  EXPECT_EQ(SolveBoth(BoundedPowell, options).our_problem->blocks[0][0], 0.7);
}

TEST(BoundsDetails, EveryOptionOfTheSearchIsRead) {
  const std::vector<std::function<void(Options*)>> settings = {
      [](Options* o) { o->max_num_line_search_step_size_iterations = 0; },
      [](Options* o) { o->max_num_line_search_step_size_iterations = 1; },
      [](Options* o) { o->min_line_search_step_size = 0.4; },
      [](Options* o) { o->line_search_sufficient_function_decrease = 0.7; },
      [](Options* o) { o->max_line_search_step_contraction = 0.55; },
      [](Options* o) { o->min_line_search_step_contraction = 0.05; },
  };
  Options plain;
  plain.linear_solver_type = ceres::DENSE_QR;
  plain.max_num_iterations = 20;
  const BothSolved before = SolveBoth(InactiveBounds, plain);
  for (std::size_t k = 0; k < settings.size(); ++k) {
    SCOPED_TRACE(k);
    Options options = plain;
    settings[k](&options);
    const BothSolved both = SolveBoth(InactiveBounds, options);
    ExpectSameSummary(both, 1e-8, true);
    ExpectSameParameters(both, 1e-8);
    EXPECT_NE(both.ours.num_residual_evaluations + both.ours.num_jacobian_evaluations,
              before.ours.num_residual_evaluations + before.ours.num_jacobian_evaluations)
        << "the setting should change the path";
    EXPECT_EQ(both.report.options_without_effect, std::vector<std::string>{});
  }
}

TEST(BoundsDetails, TrialsThatCannotBeEvaluated) {
  for (const bool with_nan : {false, true}) {
    for (const auto interpolation : {ceres::BISECTION, ceres::QUADRATIC, ceres::CUBIC}) {
      for (const double fail_beyond : {1.25, 1.2001}) {
        Options options;
        options.linear_solver_type = ceres::DENSE_QR;
        options.line_search_interpolation_type = interpolation;
        options.max_num_iterations = 25;
        const auto recipe = [&] {
          return MakeValley(-1.2, -5.0, 5.0, Valley(fail_beyond, with_nan));
        };
        const BothSolved both = SolveBoth(recipe, options);
        ExpectSameSummary(both, 1e-8, true);
        ExpectSameParameters(both, 1e-8);
      }
    }
  }
}

TEST(BoundsDetails, FailureAtTheStartLeavesTheInfeasibleStart) {
  const auto recipe = [] { return MakeValley(-9.0, -2.0, 2.0, Valley(1.5)); };
  const BothSolved both = SolveBoth(recipe, Options());
  EXPECT_EQ(both.ours.termination_type, ceres::FAILURE);
  ExpectSameSummary(both, 1e-9, true);
  EXPECT_EQ(both.our_problem->blocks, both.stock_problem->blocks);
  EXPECT_EQ(both.our_problem->blocks[0][0], -9.0);
}

TEST(BoundsDetails, MemoryUnderCallbacks) {
  for (const bool update : {false, true}) {
    for (const auto with : {ceres::SOLVER_TERMINATE_SUCCESSFULLY, ceres::SOLVER_ABORT}) {
      for (const int at : {0, 2}) {
        std::vector<std::unique_ptr<Recorder>> watches;
        Options options;
        options.linear_solver_type = ceres::DENSE_QR;
        options.update_state_every_iteration = update;
        const BothSolved both =
            SolveBoth(StartOutside, options, [&](TestProblem* test, Options* adjusted) {
              watches.push_back(std::make_unique<Recorder>(test, at, with));
              adjusted->callbacks.push_back(watches.back().get());
            });
        ExpectSameSummary(both, 1e-9, true);
        ExpectSameParameters(both, 1e-9);
        ASSERT_EQ(watches[0]->memory.size(), watches[1]->memory.size());
        for (std::size_t k = 0; k < watches[0]->memory.size(); ++k) {
          EXPECT_NEAR(watches[0]->memory[k][0][0], watches[1]->memory[k][0][0], 1e-9);
        }
        EXPECT_EQ(watches[1]->memory[0][0][0], update ? -2.0 : -9.0) << "projected at iteration 0";
        if (with == ceres::SOLVER_ABORT) {
          EXPECT_EQ(both.our_problem->blocks[0][0], -9.0);
        }
      }
    }
  }
}

TEST(BoundsDetails, ConstantBlockWithBounds) {
  for (const bool also_variable : {false, true}) {
    const auto recipe = [also_variable] {
      auto test = testing::MakePowell();
      test->problem.SetParameterBlockConstant(test->blocks[3].data());
      test->problem.SetParameterLowerBound(test->blocks[3].data(), 0, 1.0);
      if (also_variable) {
        test->problem.SetParameterUpperBound(test->blocks[1].data(), 0, -0.5);
      }
      return test;
    };
    Options options;
    options.linear_solver_type = ceres::DENSE_QR;
    const BothSolved both = SolveBoth(recipe, options);
    EXPECT_EQ(both.ours.is_constrained, also_variable);
    ExpectSameSummary(both, 1e-9, true);
    ExpectSameParameters(both, 1e-8);
  }
}

// A bounded block that nothing touches is not part of the reduced program: no line search.
TEST(BoundsDetails, BoundsOnAnUnusedBlockDoNotConstrain) {
  const auto recipe = [] {
    auto test = testing::MakePowell();
    double* unused = test->Add({7.0});
    test->problem.AddParameterBlock(unused, 1);
    test->problem.SetParameterUpperBound(unused, 0, 5.0);
    return test;
  };
  const BothSolved both = SolveBoth(recipe, Options());
  EXPECT_FALSE(both.ours.is_constrained);
  ExpectSameSummary(both, 1e-9, true);
  EXPECT_EQ(both.our_problem->blocks.back()[0], 7.0) << "not even projected";
}

TEST(BoundsDetails, InfinitiesAndNanAreNoBounds) {
  const double infinity = std::numeric_limits<double>::infinity();
  const auto recipe = [&] {
    auto test = testing::MakePowell();
    test->problem.SetParameterUpperBound(test->blocks[0].data(), 0,
                                         1e9);  // so that the next is stored
    test->problem.SetParameterUpperBound(test->blocks[0].data(), 0, infinity);
    test->problem.SetParameterLowerBound(test->blocks[1].data(), 0, -infinity);
    test->problem.SetParameterLowerBound(test->blocks[2].data(), 0, std::nan(""));
    return test;
  };
  const BothSolved both = SolveBoth(recipe, Options());
  EXPECT_FALSE(both.ours.is_constrained);
  ExpectSameSummary(both, 1e-9, true);
  ExpectSameParameters(both, 1e-8);
}

}  // namespace
}  // namespace inceres
