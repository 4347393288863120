// docs/ceres_contract.md, "Linear solver options". Test names are the fields'. Orderings are next
// to stock in adapters/summary_test.cc.
#include "conformance/support.h"

namespace conformance {
namespace {

bool IsIterative(ceres::LinearSolverType type) {
  return type == ceres::ITERATIVE_SCHUR || type == ceres::CGNR;
}

TEST(Options23, linear_solver_type) {
  for (const auto type :
       {ceres::DENSE_NORMAL_CHOLESKY, ceres::DENSE_QR, ceres::SPARSE_NORMAL_CHOLESKY,
        ceres::DENSE_SCHUR, ceres::SPARSE_SCHUR, ceres::ITERATIVE_SCHUR, ceres::CGNR}) {
    Bundle bundle;
    Options options;
    options.linear_solver_type = type;
    const Summary summary =
        Solve(options, &bundle.problem, IsIterative(type) ? Solver::kAnyone : Solver::kOurs)
            .summary;
    EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE);
    EXPECT_EQ(summary.linear_solver_type_given, type);
    EXPECT_EQ(summary.linear_solver_type_used, type);
    ExpectClose(summary.final_cost, 3.36913424893, 1e-6);
  }
}

TEST(Options23, linear_solver_type_default_is_sparse_normal_cholesky) {
  Bundle bundle;
  EXPECT_EQ(Solve(Options(), &bundle.problem).summary.linear_solver_type_used,
            ceres::SPARSE_NORMAL_CHOLESKY);
}

// J = [1 1; 0 1e-9]: its normal equations have lost the second row, a QR factorization has not.
TEST(Options23, linear_solver_type_dense_qr_does_not_square_the_condition) {
  World world;
  double* x = world.Add({0.0, 0.0});
  auto* cost = new Cost(2, {2}, [](double const* const* p, double* residuals, double** jacobians) {
    residuals[0] = p[0][0] + p[0][1] - 2.0;
    residuals[1] = 1e-9 * (p[0][1] - 1.0);
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      const double jacobian[4] = {1.0, 1.0, 0.0, 1e-9};
      std::copy(jacobian, jacobian + 4, jacobians[0]);
    }
    return true;
  });
  world.problem.AddResidualBlock(cost, nullptr, x);
  Options options = Small();
  options.initial_trust_region_radius = options.max_trust_region_radius = 1e30;
  options.max_num_iterations = 3;
  options.function_tolerance = options.gradient_tolerance = options.parameter_tolerance = 0.0;
  Solve(options, &world.problem);
  EXPECT_NEAR(x[1], 1.0, 1e-5);
}

TEST(Options23, residual_blocks_for_subset_preconditioner) {
  Bundle bundle;
  Options options = Schur();
  std::vector<ceres::ResidualBlockId> ids;
  bundle.problem.GetResidualBlocks(&ids);
  options.residual_blocks_for_subset_preconditioner.insert(ids.begin(), ids.begin() + 5);
  EXPECT_EQ(Solve(options, &bundle.problem).summary.termination_type, ceres::CONVERGENCE);
  options.linear_solver_type = ceres::CGNR;
  options.preconditioner_type = ceres::SUBSET;
  bundle.cameras[0][0] += 1.0;
  const Summary summary = Solve(options, &bundle.problem, Solver::kAnyone).summary;
  EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE);
  EXPECT_EQ(summary.preconditioner_type_used, ceres::SUBSET);
}

TEST(Options23, dense_linear_algebra_library_type_that_is_not_there) {
  Bundle bundle;
  Options options = Schur();
  options.dense_linear_algebra_library_type = ceres::CUDA;
  const Outcome outcome = Solve(options, &bundle.problem);
  EXPECT_EQ(outcome.summary.termination_type, ceres::FAILURE);
  EXPECT_EQ(outcome.summary.message,
            kRelease >= 202
                ? "Can't use DENSE_SCHUR with dense_linear_algebra_library_type = CUDA because "
                  "support not enabled when Ceres was "
                  "built."
                : "Can't use DENSE_SCHUR with Solver::Options::dense_linear_algebra_library_type = "
                  "CUDA because CUDA was not enabled "
                  "when Ceres was built.");
}

TEST(Options23, sparse_linear_algebra_library_type_that_is_not_there) {
  for (const auto library : {ceres::ACCELERATE_SPARSE, ceres::NO_SPARSE}) {
    Bundle bundle;
    Options options;
    options.linear_solver_type = ceres::SPARSE_SCHUR;
    options.sparse_linear_algebra_library_type = library;
    const Summary summary = Solve(options, &bundle.problem).summary;
    EXPECT_EQ(summary.termination_type, ceres::FAILURE);
    EXPECT_TRUE(StartsWith(summary.message, "Can't use SPARSE_SCHUR ")) << summary.message;
  }
}

TEST(Options23, linear_solver_ordering_that_is_empty_dies) {
  Bundle bundle;
  Options options = Schur();
  options.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  EXPECT_DEATH(Solve(options, &bundle.problem), "NumGroups");
}

TEST(Options23, dynamic_sparsity) {
  Bundle bundle;
  Options options;
  options.dynamic_sparsity = true;
  const Summary summary = Solve(options, &bundle.problem).summary;
  EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE);
  ExpectClose(summary.final_cost, 3.36913424893, 1e-6);
}

TEST(Options23, dynamic_sparsity_is_for_sparse_normal_cholesky) {
  Bundle bundle;
  Options options = Schur();
  options.dynamic_sparsity = true;
  EXPECT_EQ(Solve(options, &bundle.problem).summary.termination_type, ceres::FAILURE);
}

TEST(Options23, use_mixed_precision_solves) {
  Bundle bundle;
  Options options;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.sparse_linear_algebra_library_type = ceres::EIGEN_SPARSE;
  options.use_mixed_precision_solves = true;
  const Summary summary = Solve(options, &bundle.problem).summary;
  EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE);
  ExpectClose(summary.final_cost, 3.36913424893, 1e-5);
}

}  // namespace
}  // namespace conformance
