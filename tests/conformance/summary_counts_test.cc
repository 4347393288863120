// docs/ceres_contract.md, "Summary fields": costs, counts and times of a solve. Test names are the
// fields'.
#include <cmath>
#include <limits>
#include <thread>

#include "conformance/support.h"

namespace conformance {
namespace {

TEST(Summary31, preprocessor_time_in_seconds) {
  Rosenbrock rosenbrock;
  const Summary summary = Solve(Small(), &rosenbrock.problem).summary;
  EXPECT_GE(summary.preprocessor_time_in_seconds, 0.0);
  EXPECT_GE(summary.minimizer_time_in_seconds, 0.0);
  EXPECT_GE(summary.postprocessor_time_in_seconds, 0.0);
  EXPECT_NEAR(summary.total_time_in_seconds,
              summary.preprocessor_time_in_seconds + summary.minimizer_time_in_seconds +
                  summary.postprocessor_time_in_seconds,
              0.1 * summary.total_time_in_seconds + 1e-4);
}

TEST(Summary31, minimizer_time_in_seconds_after_a_failed_preprocessing) {
  Line line(std::numeric_limits<double>::quiet_NaN());
  const Summary summary = Solve(Small(), &line.problem).summary;
  EXPECT_EQ(summary.minimizer_time_in_seconds, -1.0);
  EXPECT_GE(summary.preprocessor_time_in_seconds, 0.0);
  EXPECT_GE(summary.postprocessor_time_in_seconds, 0.0);
  EXPECT_GE(summary.total_time_in_seconds, 0.0);
}

TEST(Summary31, initial_cost) {
  Line line;
  EXPECT_EQ(Solve(Small(), &line.problem).summary.initial_cost, 45.125);
  Line failing;
  failing.problem.AddResidualBlock(new Cost(1, {1}, [](auto...) { return false; }), nullptr,
                                   failing.x);
  EXPECT_EQ(Solve(Small(), &failing.problem).summary.initial_cost, -1.0);
}

TEST(Summary31, initial_cost_is_that_of_the_projected_start) {
  Line line;
  line.problem.SetParameterLowerBound(line.x, 0, 8.0);
  const Summary summary = Solve(Small(), &line.problem).summary;
  EXPECT_EQ(summary.initial_cost, 2.0);
  EXPECT_NEAR(line.x[0], 10.0, 1e-6);
}

// A minimum over the trace, steps included that were rejected although they lowered the cost.
TEST(Summary31, final_cost) {
  Parabola parabola;
  Options options = Small();
  options.min_relative_decrease = 0.95;
  options.max_num_iterations = 1;
  const Summary summary = Solve(options, &parabola.problem).summary;
  EXPECT_EQ(parabola.x[0], 1.0);
  EXPECT_EQ(summary.initial_cost, 0.5);
  EXPECT_NEAR(summary.final_cost, 0.03125, 1e-4);
  EXPECT_EQ(summary.final_cost, summary.iterations[1].cost);
}

// The last candidate of a tolerance termination is not in it.
TEST(Summary31, final_cost_without_the_discarded_candidate) {
  Parabola parabola;
  Options options = Small();
  options.function_tolerance = 0.95;
  EXPECT_EQ(Solve(options, &parabola.problem).summary.final_cost, 0.5);
}

// The iteration that ends by a tolerance is not appended: 3 rows for the line, one row and no other
// for the parabola.
TEST(Summary31, iterations) {
  Line line;
  EXPECT_EQ(Solve(Small(), &line.problem).summary.iterations.size(), 3u);
  Parabola parabola;
  Options options = Small();
  options.function_tolerance = 0.95;
  EXPECT_EQ(Solve(options, &parabola.problem).summary.iterations.size(), 1u);
}

TEST(Summary31, num_successful_steps) {
  Line line;
  const Summary summary = Solve(Small(), &line.problem).summary;
  EXPECT_EQ(summary.num_successful_steps, 3) << "iteration 0 counts";
  EXPECT_EQ(summary.num_unsuccessful_steps, 0);
  Line failing;
  failing.problem.AddResidualBlock(new Cost(1, {1}, [](auto...) { return false; }), nullptr,
                                   failing.x);
  const Summary failed = Solve(Small(), &failing.problem).summary;
  EXPECT_EQ(failed.num_successful_steps, 0);
  EXPECT_EQ(failed.num_unsuccessful_steps, 0);
  Line constant;
  constant.problem.SetParameterBlockConstant(constant.x);
  EXPECT_EQ(Solve(Small(), &constant.problem).summary.num_successful_steps, -1);
}

TEST(Summary31, num_inner_iteration_steps) {
  Line line;
  EXPECT_EQ(Solve(Small(), &line.problem).summary.num_inner_iteration_steps, -1);
}

// S, U and T of docs/ceres_contract.md, "Summary fields".
TEST(Summary31, num_linear_solves) {
  for (const double function_tolerance : {1e-6, 0.0}) {
    Rosenbrock rosenbrock;
    Options options = Small();
    options.function_tolerance = function_tolerance;
    options.max_num_iterations = 20;
    const Summary summary = Solve(options, &rosenbrock.problem).summary;
    const int S = summary.num_successful_steps;
    const int U = summary.num_unsuccessful_steps;
    const int T =
        StartsWith(summary.message, "Function") || StartsWith(summary.message, "Parameter") ? 1 : 0;
    EXPECT_GT(U, 0);
    EXPECT_EQ(S + U, static_cast<int>(summary.iterations.size()));
    EXPECT_EQ(summary.num_jacobian_evaluations, S);
    EXPECT_EQ(summary.num_residual_evaluations, S - 1 + U + T);
    EXPECT_EQ(summary.num_linear_solves, S - 1 + U + T);
  }
}

TEST(Summary31, num_linear_solves_with_invalid_steps) {
  NeverValid world;
  Options options = Small();
  options.gradient_tolerance = 0.0;
  options.max_num_iterations = 3;
  const Summary summary = Solve(options, &world.problem).summary;
  EXPECT_EQ(summary.termination_type, ceres::NO_CONVERGENCE);
  EXPECT_EQ(summary.num_unsuccessful_steps, 3);
  EXPECT_EQ(summary.num_jacobian_evaluations, 1);
  EXPECT_EQ(summary.num_residual_evaluations, 0) << "an invalid step is not evaluated";
  EXPECT_EQ(summary.num_linear_solves, 3);
}

// A rejected Dog-Leg step is followed by another mix of the same two steps.
TEST(Summary31, num_linear_solves_of_dogleg) {
  Rosenbrock rosenbrock;
  Options options = Small();
  options.trust_region_strategy_type = ceres::DOGLEG;
  const Summary summary = Solve(options, &rosenbrock.problem).summary;
  EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE);
  EXPECT_GT(summary.num_unsuccessful_steps, 0);
  EXPECT_LT(summary.num_linear_solves, static_cast<int>(summary.iterations.size()) - 1);
  for (std::size_t i = 2; i < summary.iterations.size(); ++i) {
    EXPECT_EQ(summary.iterations[i].linear_solver_iterations,
              summary.iterations[i - 1].step_is_successful ? 1 : 0)
        << i;
  }
}

TEST(Summary31, num_linear_solves_without_a_linear_solver) {
  Line constant;
  constant.problem.SetParameterBlockConstant(constant.x);
  const Summary summary = Solve(Small(), &constant.problem).summary;
  EXPECT_EQ(summary.num_linear_solves, -1);
  EXPECT_EQ(summary.linear_solver_time_in_seconds, -1.0);
}

TEST(Summary31, num_residual_evaluations) {
  Line constant;
  constant.problem.SetParameterBlockConstant(constant.x);
  const Summary nothing = Solve(Small(), &constant.problem).summary;
  EXPECT_EQ(nothing.num_residual_evaluations, -1);
  EXPECT_EQ(nothing.residual_evaluation_time_in_seconds, -1.0);
  Line line;
  const Summary summary = Solve(Small(), &line.problem).summary;
  EXPECT_EQ(summary.num_residual_evaluations, 3) << "the step that ended it included";
  EXPECT_GE(summary.residual_evaluation_time_in_seconds, 0.0);
}

TEST(Summary31, num_jacobian_evaluations) {
  Line constant;
  constant.problem.SetParameterBlockConstant(constant.x);
  const Summary nothing = Solve(Small(), &constant.problem).summary;
  EXPECT_EQ(nothing.num_jacobian_evaluations, -1);
  EXPECT_EQ(nothing.jacobian_evaluation_time_in_seconds, -1.0);
  Line line;
  const Summary summary = Solve(Small(), &line.problem).summary;
  EXPECT_EQ(summary.num_jacobian_evaluations, 3);
  EXPECT_GE(summary.jacobian_evaluation_time_in_seconds, 0.0);
}

TEST(Summary31, num_threads_used) {
  for (const int given : {1, 2}) {
    Line line;
    Options options = Small();
    options.num_threads = given;
    const Summary summary = Solve(options, &line.problem).summary;
    EXPECT_EQ(summary.num_threads_given, given);
    EXPECT_EQ(summary.num_threads_used,
              std::min(given, static_cast<int>(std::thread::hardware_concurrency())));
  }
}

TEST(Summary31, linear_solver_type_used) {
  Line line;
  EXPECT_EQ(Solve(Small(), &line.problem).summary.linear_solver_type_used, ceres::DENSE_QR);
  Line constant;
  constant.problem.SetParameterBlockConstant(constant.x);
  EXPECT_EQ(Solve(Small(), &constant.problem).summary.linear_solver_type_used,
            ceres::SPARSE_NORMAL_CHOLESKY);
  Line broken(std::numeric_limits<double>::quiet_NaN());
  EXPECT_EQ(Solve(Small(), &broken.problem).summary.linear_solver_type_used,
            ceres::SPARSE_NORMAL_CHOLESKY);
}

// ITERATIVE_SCHUR without E blocks becomes CGNR, and its preconditioner follows.
TEST(Summary31, preconditioner_type_used) {
  Bundle bundle;
  Options options;
  options.linear_solver_type = ceres::ITERATIVE_SCHUR;
  options.preconditioner_type = ceres::SCHUR_JACOBI;
  options.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (double* point : bundle.points) {
    bundle.problem.SetParameterBlockConstant(point);
    options.linear_solver_ordering->AddElementToGroup(point, 0);
  }
  for (double* camera : bundle.cameras) {
    options.linear_solver_ordering->AddElementToGroup(camera, 1);
  }
  const Summary summary = Solve(options, &bundle.problem, Solver::kAnyone).summary;
  EXPECT_EQ(summary.linear_solver_type_used, ceres::CGNR);
  EXPECT_EQ(summary.preconditioner_type_given, ceres::SCHUR_JACOBI);
  EXPECT_EQ(summary.preconditioner_type_used, ceres::JACOBI);
}

}  // namespace
}  // namespace conformance
