// docs/ceres_contract.md, "Summary fields": what a summary tells of the problem. Test names are the
// fields'.
#include <limits>

#include "conformance/support.h"
#include "support/ceres_manifolds.h"

namespace conformance {
namespace {

// Every option that is copied, away from its default.
TEST(Summary31, copied_from_options) {
  Line line;
  Options options;
  options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
  options.trust_region_strategy_type = ceres::DOGLEG;
  options.dense_linear_algebra_library_type = ceres::LAPACK;
  options.sparse_linear_algebra_library_type = ceres::EIGEN_SPARSE;
  options.visibility_clustering_type = ceres::SINGLE_LINKAGE;
  options.line_search_direction_type = ceres::NONLINEAR_CONJUGATE_GRADIENT;
  options.line_search_type = ceres::ARMIJO;
  options.line_search_interpolation_type = ceres::QUADRATIC;
  options.nonlinear_conjugate_gradient_type = ceres::POLAK_RIBIERE;
  options.max_lbfgs_rank = 3;
  options.preconditioner_type = ceres::IDENTITY;
  options.num_threads = 2;
  const Summary summary = Solve(options, &line.problem).summary;
  EXPECT_EQ(summary.minimizer_type, ceres::TRUST_REGION);
  EXPECT_EQ(summary.trust_region_strategy_type, ceres::DOGLEG);
  EXPECT_EQ(summary.dogleg_type, ceres::TRADITIONAL_DOGLEG);
  EXPECT_EQ(summary.dense_linear_algebra_library_type, ceres::LAPACK);
  EXPECT_EQ(summary.sparse_linear_algebra_library_type, ceres::EIGEN_SPARSE);
  EXPECT_EQ(summary.visibility_clustering_type, ceres::SINGLE_LINKAGE);
  EXPECT_EQ(summary.line_search_direction_type, ceres::NONLINEAR_CONJUGATE_GRADIENT);
  EXPECT_EQ(summary.line_search_type, ceres::ARMIJO);
  EXPECT_EQ(summary.line_search_interpolation_type, ceres::QUADRATIC);
  EXPECT_EQ(summary.nonlinear_conjugate_gradient_type, ceres::POLAK_RIBIERE);
  EXPECT_EQ(summary.max_lbfgs_rank, 3);
  EXPECT_EQ(summary.linear_solver_type_given, ceres::DENSE_NORMAL_CHOLESKY);
  EXPECT_EQ(summary.preconditioner_type_given, ceres::IDENTITY);
  EXPECT_EQ(summary.num_threads_given, 2);
  EXPECT_FALSE(summary.inner_iterations_given);
}

// Group sizes in the order of group ids, as given: a constant block and one without residuals are
// still in it.
TEST(Summary31, linear_solver_ordering_given) {
  Bundle bundle;
  double* unused = bundle.Add({1.0});
  bundle.problem.AddParameterBlock(unused, 1);
  bundle.problem.SetParameterBlockConstant(bundle.cameras[0]);
  Options options = Schur();
  options.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (double* point : bundle.points) {
    options.linear_solver_ordering->AddElementToGroup(point, 4);
  }
  for (double* camera : bundle.cameras) {
    options.linear_solver_ordering->AddElementToGroup(camera, 9);
  }
  options.linear_solver_ordering->AddElementToGroup(unused, 11);
  const Summary summary = Solve(options, &bundle.problem).summary;
  EXPECT_EQ(summary.linear_solver_ordering_given, (std::vector<int>{8, 3, 1}));
  EXPECT_EQ(summary.linear_solver_ordering_used, (std::vector<int>{8, 2}));
  EXPECT_TRUE(Solve(Schur(), &bundle.problem).summary.linear_solver_ordering_given.empty());
}

// A block of size 3 with two degrees of freedom, a constant one of size 2, one without residuals,
// and one fixed residual.
struct Mixed : World {
  Mixed() {
    double* x = Add({1.0, 2.0, 3.0});
    double* c = Add({1.0, 1.0});
    double* unused = Add({5.0, 5.0, 5.0, 5.0});
    problem.AddResidualBlock(Target({0.0, 0.0, 0.0}), nullptr, x);
    problem.AddResidualBlock(Target({2.0, 1.0}), nullptr, c);
    problem.AddParameterBlock(unused, 4);
    manifolds::Set(&problem, x, new manifolds::SubsetManifold(3, {1}));
    problem.SetParameterBlockConstant(c);
  }
};

TEST(Summary31, num_parameter_blocks) {
  Mixed mixed;
  const Summary summary = Solve(Small(), &mixed.problem).summary;
  EXPECT_EQ(summary.num_parameter_blocks, 3);
  EXPECT_EQ(summary.num_parameters, 9);
  EXPECT_EQ(summary.num_effective_parameters, 8) << "constant blocks count with their tangent size";
  EXPECT_EQ(summary.num_residual_blocks, 2);
  EXPECT_EQ(summary.num_residuals, 5);
}

TEST(Summary31, num_parameter_blocks_reduced) {
  Mixed mixed;
  const Summary summary = Solve(Small(), &mixed.problem).summary;
  EXPECT_EQ(summary.num_parameter_blocks_reduced, 1);
  EXPECT_EQ(summary.num_parameters_reduced, 3);
  EXPECT_EQ(summary.num_effective_parameters_reduced, 2);
  EXPECT_EQ(summary.num_residual_blocks_reduced, 1);
  EXPECT_EQ(summary.num_residuals_reduced, 3);
}

TEST(Summary31, num_parameter_blocks_reduced_of_constants_and_failures) {
  Mixed constant;
  constant.problem.SetParameterBlockConstant(constant.blocks[0].data());
  EXPECT_EQ(Solve(Small(), &constant.problem).summary.num_parameter_blocks_reduced, 0);
  EXPECT_EQ(Solve(Small(), &constant.problem).summary.num_residuals_reduced, 0);
  Mixed failing;
  failing.blocks[2][1] = std::numeric_limits<double>::infinity();
  EXPECT_EQ(Solve(Small(), &failing.problem).summary.num_parameter_blocks_reduced, -1);
  EXPECT_EQ(Solve(Small(), &failing.problem).summary.num_residuals_reduced, -1);
}

TEST(Summary31, num_line_search_steps) {
  Line line;
  const Summary summary = Solve(Small(), &line.problem).summary;
  EXPECT_EQ(summary.num_line_search_steps, 0);
  EXPECT_EQ(summary.line_search_cost_evaluation_time_in_seconds, 0.0);
  EXPECT_EQ(summary.line_search_gradient_evaluation_time_in_seconds, 0.0);
  EXPECT_EQ(summary.line_search_polynomial_minimization_time_in_seconds, 0.0);
  EXPECT_EQ(summary.line_search_total_time_in_seconds, 0.0);
  EXPECT_EQ(summary.inner_iteration_time_in_seconds, 0.0);
}

TEST(Summary31, schur_structure_given) {
  Bundle bundle;
  const Summary summary = Solve(Schur(), &bundle.problem).summary;
  EXPECT_EQ(summary.schur_structure_given, "2,3,6");
  EXPECT_EQ(summary.schur_structure_used, Specialized("2,3,6"));
  Bundle again;
  const Summary without = Solve(Small(), &again.problem).summary;
  EXPECT_EQ(without.schur_structure_given, "");
  EXPECT_EQ(without.schur_structure_used, "");
}

TEST(Summary31, schur_structure_given_without_f_blocks) {
  Bundle bundle;
  for (double* camera : bundle.cameras) {
    bundle.problem.SetParameterBlockConstant(camera);
  }
  const Summary summary = Solve(Schur(), &bundle.problem).summary;
  EXPECT_EQ(summary.schur_structure_given, "2,3,0");
  EXPECT_EQ(summary.schur_structure_used, Specialized("2,3,d"));
}

TEST(Summary31, schur_structure_given_with_residuals_of_several_sizes) {
  Bundle bundle;
  bundle.problem.AddResidualBlock(Coupled(4, {6, 3}, 1), nullptr, bundle.cameras[0],
                                  bundle.points[0]);
  const Summary summary = Solve(Schur(), &bundle.problem).summary;
  EXPECT_EQ(summary.schur_structure_given, "d,3,6");
  EXPECT_EQ(summary.schur_structure_used, "d,d,d");
}

// ½ρ(s): a Huber loss of width 1 makes 3 of s = 4; without loss the other gives ½.
TEST(Summary31, fixed_cost) {
  Line line;
  double* c = line.Add({1.0});
  line.problem.AddResidualBlock(Target({3.0}), new ceres::HuberLoss(1.0), c);
  line.problem.AddResidualBlock(Target({2.0}), nullptr, c);
  line.problem.SetParameterBlockConstant(c);
  const Summary summary = Solve(Small(), &line.problem).summary;
  EXPECT_EQ(summary.fixed_cost, 2.0);
  EXPECT_EQ(summary.initial_cost, 45.125 + 2.0);
  EXPECT_EQ(summary.iterations[0].cost, 45.125 + 2.0);
  ExpectClose(summary.final_cost, 2.0);
  Line none;
  EXPECT_EQ(Solve(Small(), &none.problem).summary.fixed_cost, 0.0);
}

TEST(Summary31, is_constrained) {
  Line none;
  EXPECT_FALSE(Solve(Small(), &none.problem).summary.is_constrained);
  Line bounded;
  bounded.problem.SetParameterUpperBound(bounded.x, 0, 1e6);
  EXPECT_TRUE(Solve(Small(), &bounded.problem).summary.is_constrained);
  Line elsewhere;  // on a constant block, and on one without residuals
  double* c = elsewhere.Add({1.0});
  double* unused = elsewhere.Add({1.0});
  elsewhere.problem.AddResidualBlock(Target({2.0}), nullptr, c);
  elsewhere.problem.SetParameterBlockConstant(c);
  elsewhere.problem.AddParameterBlock(unused, 1);
  elsewhere.problem.SetParameterUpperBound(c, 0, 10.0);
  elsewhere.problem.SetParameterUpperBound(unused, 0, 10.0);
  EXPECT_FALSE(Solve(Small(), &elsewhere.problem).summary.is_constrained);
}

TEST(Summary31, linear_solver_ordering_used) {
  Bundle automatic;
  EXPECT_EQ(Solve(Schur(), &automatic.problem).summary.linear_solver_ordering_used,
            (std::vector<int>{8, 3}));
  Bundle normal;
  EXPECT_EQ(Solve(Options(), &normal.problem).summary.linear_solver_ordering_used,
            (std::vector<int>{11}));
  Bundle points_only;
  for (double* camera : points_only.cameras) {
    points_only.problem.SetParameterBlockConstant(camera);
  }
  EXPECT_EQ(Solve(Schur(), &points_only.problem).summary.linear_solver_ordering_used,
            (std::vector<int>{8}));
}

TEST(Summary31, inner_iterations_used) {
  Line line;
  const Summary summary = Solve(Small(), &line.problem).summary;
  EXPECT_FALSE(summary.inner_iterations_used);
  EXPECT_TRUE(summary.inner_iteration_ordering_used.empty());
  EXPECT_EQ(summary.num_inner_iteration_steps, -1);
}

// "Reports": those that Ceres makes of a summary; their text is next to stock's in
// adapters/summary_test.cc.

TEST(Report33, IsSolutionUsable) {
  Line line;
  Options options = Small();
  EXPECT_TRUE(Solve(options, &line.problem).summary.IsSolutionUsable());
  options.max_num_iterations = 0;
  EXPECT_TRUE(Solve(options, &line.problem).summary.IsSolutionUsable());
  Callback abort([](const ceres::IterationSummary&) { return ceres::SOLVER_ABORT; });
  options.callbacks.push_back(&abort);
  EXPECT_FALSE(Solve(options, &line.problem).summary.IsSolutionUsable());
  line.x[0] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(Solve(options, &line.problem).summary.IsSolutionUsable());
}

// Invalid options: nothing but the message is written.
TEST(Report33, FullReportOfInvalidOptions) {
  Line line;
  Options options = Small();
  options.max_num_iterations = -1;
  const Outcome outcome = Solve(options, &line.problem);
  const std::string reason =
      "Invalid configuration. Solver::Options::max_num_iterations = -1. Violated constraint: "
      "Solver::Options::max_num_iterations >= 0";
  EXPECT_EQ(outcome.summary.message, reason);
  EXPECT_EQ(outcome.errors, std::vector<std::string>{"Terminating: " + reason});
  EXPECT_EQ(outcome.summary.termination_type, ceres::FAILURE);
  EXPECT_EQ(outcome.summary.num_parameter_blocks, -1);
  EXPECT_EQ(outcome.summary.initial_cost, -1.0);
  EXPECT_EQ(outcome.summary.final_cost, -1.0);
  EXPECT_EQ(outcome.summary.total_time_in_seconds, -1.0);
  EXPECT_EQ(outcome.summary.num_successful_steps, -1);
  EXPECT_EQ(line.x[0], 0.5);
}

// What a summary holds from before does not show.
TEST(Report33, SummariesAreResetFirst) {
  Line line;
  Summary summary = Solve(Small(), &line.problem).summary;
  Options options = Small();
  options.max_num_iterations = -1;
  ceres::Solve(options, &line.problem, &summary);
  EXPECT_TRUE(summary.iterations.empty());
  EXPECT_EQ(summary.num_jacobian_evaluations, -1);
}

}  // namespace
}  // namespace conformance
