#include "adapters/ceres/plan/option_mapping.h"

#include <algorithm>

#include <gtest/gtest.h>

#include "adapters/compare_with_stock.h"

namespace inceres::internal {
namespace {

using Options = ceres::Solver::Options;
using Names = std::vector<std::string>;

Names WithoutEffect(const Options& options) {
  return OptionsWithoutEffect(options, LandmarkSelection(), /*is_constrained=*/false);
}

TEST(OptionsWithoutEffect, DefaultsHaveNone) {
  EXPECT_EQ(WithoutEffect(Options()), Names{});
}

TEST(OptionsWithoutEffect, NamesEachThatWasSet) {
  Options options;
  options.max_lbfgs_rank = 7;
  options.eta = 0.5;
  options.use_mixed_precision_solves = true;
  options.max_num_line_search_step_size_iterations = 3;
  options.gradient_check_relative_precision = 1e-3;
  EXPECT_EQ(WithoutEffect(options),
            (Names{"max_num_line_search_step_size_iterations", "eta", "max_lbfgs_rank",
                   "use_mixed_precision_solves", "gradient_check_relative_precision"}));
}

TEST(OptionsWithoutEffect, ConjugateGradientsAreHonoredWhereTheySolve) {
  Options options;
  options.eta = 0.5;
  options.max_linear_solver_iterations = 20;
  EXPECT_EQ(WithoutEffect(options), (Names{"eta", "max_linear_solver_iterations"}));
  options.linear_solver_type = ceres::ITERATIVE_SCHUR;
  EXPECT_EQ(WithoutEffect(options), Names{});
}

TEST(OptionsWithoutEffect, DependsOnWhatElseIsSet) {
  Options options;
  options.dogleg_type = ceres::SUBSPACE_DOGLEG;
  options.max_trust_region_radius = 1e20;
  EXPECT_EQ(WithoutEffect(options), Names{"dogleg_type"});
  options.trust_region_strategy_type = ceres::DOGLEG;
  EXPECT_EQ(WithoutEffect(options), Names{"max_trust_region_radius"});
  options = Options();
  options.max_consecutive_nonmonotonic_steps = 9;
  EXPECT_EQ(WithoutEffect(options), Names{"max_consecutive_nonmonotonic_steps"});
  options.use_nonmonotonic_steps = true;
  EXPECT_EQ(WithoutEffect(options), Names{});
}

TEST(OptionsWithoutEffect, OrderingsAreReadByTheSchurTypesOnly) {
  double x[3];
  Options options;
  options.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  options.linear_solver_ordering->AddElementToGroup(&x[0], 0);
  options.linear_solver_ordering->AddElementToGroup(&x[1], 1);
  EXPECT_EQ(WithoutEffect(options), Names{"linear_solver_ordering"});
  options.linear_solver_type = ceres::DENSE_SCHUR;
  EXPECT_EQ(WithoutEffect(options), Names{});
  options.linear_solver_ordering->AddElementToGroup(&x[2], 2);
  EXPECT_EQ(WithoutEffect(options),
            Names{"linear_solver_ordering: the order of groups after the first"});
}

TEST(OptionsWithoutEffect, GroupsAfterTheFirstBreakTiesOfClusters) {
  double x[3];
  Options options;
  options.linear_solver_type = ceres::ITERATIVE_SCHUR;
  options.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (int group = 0; group < 3; ++group) {
    options.linear_solver_ordering->AddElementToGroup(&x[group], group);
  }
  const Names named{"linear_solver_ordering: the order of groups after the first"};
  options.preconditioner_type = ceres::SCHUR_JACOBI;
  EXPECT_EQ(WithoutEffect(options), named);
  for (const auto by_clusters : {ceres::CLUSTER_JACOBI, ceres::CLUSTER_TRIDIAGONAL}) {
    options.preconditioner_type = by_clusters;
    EXPECT_EQ(WithoutEffect(options), Names{});
    // Incremental mode has preconditioners of its own.
    EXPECT_EQ(IncrementalOptionsWithoutEffect(options, LandmarkCounts()),
              (Names{"preconditioner_type", named[0]}));
  }
}

TEST(OptionsWithoutEffect, BlocksTooLargeForALandmark) {
  double x[2];
  Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  options.linear_solver_ordering->AddElementToGroup(&x[0], 0);
  options.linear_solver_ordering->AddElementToGroup(&x[1], 1);
  LandmarkSelection landmarks;
  landmarks.num_too_large = 2;
  const Names names = OptionsWithoutEffect(options, landmarks, /*is_constrained=*/false);
  ASSERT_EQ(names.size(), 1u);
  EXPECT_NE(names[0].find("2 blocks of the first group have a tangent size above 4"),
            std::string::npos)
      << names[0];
}

TEST(OptionsWithoutEffect, AreInTheReport) {
  Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  options.eta = 0.2;
  const testing::BothSolved both = testing::SolveBoth(testing::MakePowell, options);
  EXPECT_EQ(both.report.options_without_effect, Names{"eta"});
}

// A callback may change the caller's; the solve goes by what they were.
TEST(OptionsWithoutEffect, AreThoseOfTheBeginning) {
  const auto test = testing::MakePowell();
  Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  options.max_lbfgs_rank = 7;
  lambdas::Callback callback([&](const ceres::IterationSummary&) {
    options.max_lbfgs_rank = Options().max_lbfgs_rank;
    options.eta = 0.2;
    return ceres::SOLVER_CONTINUE;
  });
  options.callbacks.push_back(&callback);
  ceres::Solver::Summary summary;
  SolveReport report;
  inceres::Solve(options, &test->problem, &summary, {}, &report);
  EXPECT_EQ(options.eta, 0.2);
  EXPECT_EQ(report.options_without_effect, Names{"max_lbfgs_rank"});
}

TEST(MapOptions, CopiesWhatTheCoreReads) {
  Options options;
  options.trust_region_strategy_type = ceres::DOGLEG;
  options.max_num_iterations = 3;
  options.max_solver_time_in_seconds = 4.0;
  options.function_tolerance = 0.01;
  options.gradient_tolerance = 0.02;
  options.parameter_tolerance = 0.03;
  options.initial_trust_region_radius = 5.0;
  options.max_trust_region_radius = 6.0;
  options.min_trust_region_radius = 0.5;
  options.min_relative_decrease = 0.25;
  options.min_lm_diagonal = 0.125;
  options.max_lm_diagonal = 7.0;
  options.max_num_consecutive_invalid_steps = 8;
  options.jacobi_scaling = false;
  options.use_nonmonotonic_steps = true;
  options.max_consecutive_nonmonotonic_steps = 9;
  options.eta = 0.75;
  options.line_search_interpolation_type = ceres::QUADRATIC;
  options.min_line_search_step_size = 0.0625;
  options.line_search_sufficient_function_decrease = 0.375;
  options.max_line_search_step_contraction = 0.3125;
  options.min_line_search_step_contraction = 0.4375;
  options.max_num_line_search_step_size_iterations = 11;
  const SolverOptions core = MapOptions(options, ceres::DENSE_QR);
  EXPECT_EQ(core.strategy, TrustRegionStrategyKind::kDogleg);
  EXPECT_EQ(core.linear_model, LinearModelKind::kDenseQr);
  EXPECT_EQ(core.max_num_iterations, 3);
  EXPECT_EQ(core.max_solver_time_in_seconds, 4.0);
  EXPECT_EQ(core.function_tolerance, 0.01);
  EXPECT_EQ(core.gradient_tolerance, 0.02);
  EXPECT_EQ(core.parameter_tolerance, 0.03);
  EXPECT_EQ(core.initial_trust_region_radius, 5.0);
  EXPECT_EQ(core.max_trust_region_radius, 6.0);
  EXPECT_EQ(core.min_trust_region_radius, 0.5);
  EXPECT_EQ(core.min_relative_decrease, 0.25);
  EXPECT_EQ(core.min_lm_diagonal, 0.125);
  EXPECT_EQ(core.max_lm_diagonal, 7.0);
  EXPECT_EQ(core.max_num_consecutive_invalid_steps, 8);
  EXPECT_FALSE(core.jacobi_scaling);
  EXPECT_TRUE(core.use_nonmonotonic_steps);
  EXPECT_EQ(core.max_consecutive_nonmonotonic_steps, 9);
  EXPECT_EQ(core.line_search_interpolation, LineSearchInterpolation::kQuadratic);
  EXPECT_EQ(core.min_line_search_step_size, 0.0625);
  EXPECT_EQ(core.line_search_sufficient_function_decrease, 0.375);
  EXPECT_EQ(core.max_line_search_step_contraction, 0.3125);
  EXPECT_EQ(core.min_line_search_step_contraction, 0.4375);
  EXPECT_EQ(core.max_num_line_search_step_size_iterations, 11);
  options.line_search_interpolation_type = ceres::BISECTION;
  EXPECT_EQ(MapOptions(options, ceres::DENSE_QR).line_search_interpolation,
            LineSearchInterpolation::kBisection);
  options.dogleg_type = ceres::SUBSPACE_DOGLEG;
  EXPECT_EQ(MapOptions(options, ceres::DENSE_QR).strategy,
            TrustRegionStrategyKind::kSubspaceDogleg);
  EXPECT_EQ(MapOptions(options, ceres::DENSE_SCHUR).linear_model, LinearModelKind::kAutomatic);
}

// The core's defaults are Ceres's, so that a solve by either starts from the same numbers.
TEST(MapOptions, DefaultsAgree) {
  const SolverOptions mapped = MapOptions(Options(), ceres::SPARSE_NORMAL_CHOLESKY);
  const SolverOptions defaults;
  EXPECT_EQ(mapped.max_num_iterations, defaults.max_num_iterations);
  EXPECT_EQ(mapped.function_tolerance, defaults.function_tolerance);
  EXPECT_EQ(mapped.gradient_tolerance, defaults.gradient_tolerance);
  EXPECT_EQ(mapped.parameter_tolerance, defaults.parameter_tolerance);
  EXPECT_EQ(mapped.initial_trust_region_radius, defaults.initial_trust_region_radius);
  EXPECT_EQ(mapped.max_trust_region_radius, defaults.max_trust_region_radius);
  EXPECT_EQ(mapped.min_trust_region_radius, defaults.min_trust_region_radius);
  EXPECT_EQ(mapped.min_lm_diagonal, defaults.min_lm_diagonal);
  EXPECT_EQ(mapped.max_lm_diagonal, defaults.max_lm_diagonal);
  EXPECT_EQ(mapped.jacobi_scaling, defaults.jacobi_scaling);
  EXPECT_EQ(mapped.max_num_consecutive_invalid_steps, defaults.max_num_consecutive_invalid_steps);
  EXPECT_EQ(mapped.line_search_interpolation, defaults.line_search_interpolation);
  EXPECT_EQ(mapped.min_line_search_step_size, defaults.min_line_search_step_size);
  EXPECT_EQ(mapped.line_search_sufficient_function_decrease,
            defaults.line_search_sufficient_function_decrease);
  EXPECT_EQ(mapped.max_line_search_step_contraction, defaults.max_line_search_step_contraction);
  EXPECT_EQ(mapped.min_line_search_step_contraction, defaults.min_line_search_step_contraction);
  EXPECT_EQ(mapped.max_num_line_search_step_size_iterations,
            defaults.max_num_line_search_step_size_iterations);
}

}  // namespace
}  // namespace inceres::internal
