#include "adapters/compare_with_stock.h"

#include <algorithm>
#include <cmath>
#include <map>

#include <gtest/gtest.h>

#include "inceres/ceres/session.h"

namespace inceres::testing {
namespace {

using Summary = ceres::Solver::Summary;

void ExpectClose(double a, double b, double tolerance, const char* name, int iteration) {
  if (a != b) {
    EXPECT_LE(std::abs(a - b), tolerance * std::max(std::abs(a), std::abs(b)))
        << name << " of iteration " << iteration;
  }
}

// Numbers in messages differ in their last digits: compare up to the first one.
std::string UpToNumber(const std::string& message) {
  const std::size_t colon = message.find(": ");
  return message.substr(0, colon == std::string::npos ? message.size() : colon);
}

void ExpectSameTrace(const Summary& a, const Summary& b, double tolerance) {
  ASSERT_EQ(a.iterations.size(), b.iterations.size());
  for (std::size_t k = 0; k < a.iterations.size(); ++k) {
    const ceres::IterationSummary& x = a.iterations[k];
    const ceres::IterationSummary& y = b.iterations[k];
    const int i = x.iteration;
    // Differences of costs and gradients near zero are cancellation: measure them against where
    // they started.
    const double cost_scale = a.iterations[0].cost;
    const double gradient_scale = a.iterations[0].gradient_max_norm;
    EXPECT_EQ(x.iteration, y.iteration);
    EXPECT_EQ(x.step_is_valid, y.step_is_valid) << i;
    EXPECT_EQ(x.step_is_successful, y.step_is_successful) << i;
    EXPECT_EQ(x.step_is_nonmonotonic, y.step_is_nonmonotonic) << i;
    EXPECT_EQ(x.eta, y.eta) << i;
    EXPECT_EQ(x.linear_solver_iterations, y.linear_solver_iterations) << i;
    ExpectClose(x.cost, y.cost, tolerance, "cost", i);
    EXPECT_NEAR(x.cost_change, y.cost_change,
                std::max(tolerance * cost_scale, 1e-12 * std::abs(x.cost_change)))
        << i;
    EXPECT_NEAR(x.gradient_max_norm, y.gradient_max_norm, tolerance * gradient_scale) << i;
    EXPECT_NEAR(x.gradient_norm, y.gradient_norm, tolerance * a.iterations[0].gradient_norm) << i;
    EXPECT_NEAR(x.step_norm, y.step_norm, 1e-6 * (1.0 + x.step_norm)) << i;
    ExpectClose(x.trust_region_radius, y.trust_region_radius, 1e-6, "radius", i);
    EXPECT_GE(y.iteration_time_in_seconds, 0.0);
    EXPECT_GE(y.cumulative_time_in_seconds, y.iteration_time_in_seconds);
  }
}

}  // namespace

void ExpectSameCounts(const Summary& a, const Summary& b) {
  EXPECT_EQ(a.num_successful_steps, b.num_successful_steps);
  EXPECT_EQ(a.num_unsuccessful_steps, b.num_unsuccessful_steps);
  EXPECT_EQ(a.num_inner_iteration_steps, b.num_inner_iteration_steps);
  EXPECT_EQ(a.num_line_search_steps, b.num_line_search_steps);
  EXPECT_EQ(a.num_linear_solves, b.num_linear_solves);
  EXPECT_EQ(a.num_residual_evaluations, b.num_residual_evaluations);
  EXPECT_EQ(a.num_jacobian_evaluations, b.num_jacobian_evaluations);
  EXPECT_EQ(a.num_parameter_blocks, b.num_parameter_blocks);
  EXPECT_EQ(a.num_parameters, b.num_parameters);
  EXPECT_EQ(a.num_effective_parameters, b.num_effective_parameters);
  EXPECT_EQ(a.num_residual_blocks, b.num_residual_blocks);
  EXPECT_EQ(a.num_residuals, b.num_residuals);
  EXPECT_EQ(a.num_parameter_blocks_reduced, b.num_parameter_blocks_reduced);
  EXPECT_EQ(a.num_parameters_reduced, b.num_parameters_reduced);
  EXPECT_EQ(a.num_effective_parameters_reduced, b.num_effective_parameters_reduced);
  EXPECT_EQ(a.num_residual_blocks_reduced, b.num_residual_blocks_reduced);
  EXPECT_EQ(a.num_residuals_reduced, b.num_residuals_reduced);
  EXPECT_EQ(a.num_threads_given, b.num_threads_given);
  EXPECT_EQ(a.num_threads_used, b.num_threads_used);
}

namespace {

void ExpectSameChoices(const Summary& a, const Summary& b) {
  EXPECT_EQ(a.minimizer_type, b.minimizer_type);
  EXPECT_EQ(a.is_constrained, b.is_constrained);
  EXPECT_EQ(a.linear_solver_type_given, b.linear_solver_type_given);
  EXPECT_EQ(a.linear_solver_type_used, b.linear_solver_type_used);
  EXPECT_EQ(a.linear_solver_ordering_given, b.linear_solver_ordering_given);
  EXPECT_EQ(a.inner_iterations_given, b.inner_iterations_given);
  EXPECT_EQ(a.inner_iterations_used, b.inner_iterations_used);
  EXPECT_EQ(a.inner_iteration_ordering_given, b.inner_iteration_ordering_given);
  EXPECT_EQ(a.inner_iteration_ordering_used, b.inner_iteration_ordering_used);
  EXPECT_EQ(a.preconditioner_type_given, b.preconditioner_type_given);
  EXPECT_EQ(a.preconditioner_type_used, b.preconditioner_type_used);
  EXPECT_EQ(a.visibility_clustering_type, b.visibility_clustering_type);
  EXPECT_EQ(a.trust_region_strategy_type, b.trust_region_strategy_type);
  EXPECT_EQ(a.dogleg_type, b.dogleg_type);
  EXPECT_EQ(a.dense_linear_algebra_library_type, b.dense_linear_algebra_library_type);
  EXPECT_EQ(a.sparse_linear_algebra_library_type, b.sparse_linear_algebra_library_type);
  EXPECT_EQ(a.line_search_direction_type, b.line_search_direction_type);
  EXPECT_EQ(a.line_search_type, b.line_search_type);
  EXPECT_EQ(a.line_search_interpolation_type, b.line_search_interpolation_type);
  EXPECT_EQ(a.nonlinear_conjugate_gradient_type, b.nonlinear_conjugate_gradient_type);
  EXPECT_EQ(a.max_lbfgs_rank, b.max_lbfgs_rank);
}

// A time was measured by both or by neither; zeros stay zeros.
void ExpectSameTimesSet(const Summary& a, const Summary& b) {
  EXPECT_EQ(a.preprocessor_time_in_seconds < 0.0, b.preprocessor_time_in_seconds < 0.0);
  EXPECT_EQ(a.minimizer_time_in_seconds < 0.0, b.minimizer_time_in_seconds < 0.0);
  EXPECT_EQ(a.postprocessor_time_in_seconds < 0.0, b.postprocessor_time_in_seconds < 0.0);
  EXPECT_EQ(a.total_time_in_seconds < 0.0, b.total_time_in_seconds < 0.0);
  EXPECT_EQ(a.linear_solver_time_in_seconds < 0.0, b.linear_solver_time_in_seconds < 0.0);
  EXPECT_EQ(a.residual_evaluation_time_in_seconds < 0.0,
            b.residual_evaluation_time_in_seconds < 0.0);
  EXPECT_EQ(a.jacobian_evaluation_time_in_seconds < 0.0,
            b.jacobian_evaluation_time_in_seconds < 0.0);
  EXPECT_EQ(a.inner_iteration_time_in_seconds > 0.0, b.inner_iteration_time_in_seconds > 0.0);
  for (const auto time : {&Summary::line_search_total_time_in_seconds,
                          &Summary::line_search_cost_evaluation_time_in_seconds,
                          &Summary::line_search_gradient_evaluation_time_in_seconds,
                          &Summary::line_search_polynomial_minimization_time_in_seconds}) {
    EXPECT_GE(b.*time, 0.0);
    EXPECT_TRUE(b.*time > 0.0 || a.*time == 0.0) << "Ceres took time for it";
    EXPECT_TRUE(b.*time == 0.0 || a.is_constrained);
  }
}

}  // namespace

std::string WithoutAddresses(const std::string& text) {
  std::map<std::string, int> seen;
  std::string result;
  for (std::size_t at = 0; at < text.size();) {
    if (text.compare(at, 2, "0x") != 0) {
      result += text[at++];
      continue;
    }
    const std::size_t end = text.find_first_not_of("0123456789abcdef", at + 2);
    const auto number = static_cast<int>(seen.size());
    result += "#" + std::to_string(seen.emplace(text.substr(at, end - at), number).first->second);
    at = end;
  }
  return result;
}

BothSolved SolveBoth(const Recipe& recipe, const ceres::Solver::Options& options,
                     const Adjust& adjust) {
  BothSolved both;
  both.stock_problem = recipe();
  both.our_problem = recipe();
  ceres::Solver::Options stock_options = options;
  ceres::Solver::Options our_options = options;
  if (adjust != nullptr) {
    adjust(both.stock_problem.get(), &stock_options);
    adjust(both.our_problem.get(), &our_options);
  }
  ceres::Solve(stock_options, &both.stock_problem->problem, &both.stock);
  SolveOptions solve_options;
  solve_options.evaluation_callback = both.our_problem->evaluation_callback;
  inceres::Solve(our_options, &both.our_problem->problem, &both.ours, solve_options, &both.report);
  EXPECT_FALSE(both.report.used_stock) << both.report.fallback_reason;
  return both;
}

void SolveBySessionOrOnce(bool session, const ceres::Solver::Options& options,
                          ceres::Problem* problem, const SolveOptions& asked,
                          ceres::Solver::Summary* summary, SolveReport* report) {
  if (session) {
    CeresSession().Solve(options, problem, summary, asked, report);
  } else {
    inceres::Solve(options, problem, summary, asked, report);
  }
}

void ExpectSameSummary(const BothSolved& both, double tolerance, bool same_elimination) {
  const Summary& a = both.stock;
  const Summary& b = both.ours;
  EXPECT_EQ(a.termination_type, b.termination_type) << a.message << " / " << b.message;
  EXPECT_EQ(UpToNumber(a.message), UpToNumber(b.message));
  ExpectClose(a.initial_cost, b.initial_cost, tolerance, "initial cost", -1);
  ExpectClose(a.final_cost, b.final_cost, tolerance, "final cost", -1);
  ExpectClose(a.fixed_cost, b.fixed_cost, 1e-14, "fixed cost", -1);
  ExpectSameTrace(a, b, tolerance);
  ExpectSameCounts(a, b);
  ExpectSameChoices(a, b);
  ExpectSameTimesSet(a, b);
  if (same_elimination) {
    EXPECT_EQ(a.linear_solver_ordering_used, b.linear_solver_ordering_used);
    EXPECT_EQ(a.schur_structure_given, b.schur_structure_given);
    EXPECT_EQ(a.schur_structure_used, b.schur_structure_used);
  }
}

void ExpectSameParameters(const BothSolved& both, double tolerance) {
  ASSERT_EQ(both.stock_problem->blocks.size(), both.our_problem->blocks.size());
  for (std::size_t b = 0; b < both.stock_problem->blocks.size(); ++b) {
    const std::vector<double>& x = both.stock_problem->blocks[b];
    const std::vector<double>& y = both.our_problem->blocks[b];
    for (std::size_t k = 0; k < x.size(); ++k) {
      EXPECT_NEAR(x[k], y[k], tolerance * (1.0 + std::abs(x[k])))
          << "block " << b << " entry " << k;
    }
  }
}

}  // namespace inceres::testing
