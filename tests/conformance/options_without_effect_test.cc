// docs/ceres_contract.md: options that change nothing of these solves, but are told in the summary
// where it has a field for them. Names of rows are the fields'.
#include <ostream>

#include "conformance/support.h"

namespace conformance {
namespace {

Options With(ceres::LinearSolverType type, ceres::SparseLinearAlgebraLibraryType sparse) {
  Options options;
  options.linear_solver_type = type;
  options.sparse_linear_algebra_library_type = sparse;
  return options;
}

struct Row {
  const char* field;
  Options base;
  void (*change)(Options*);
  bool (*is_told)(const Summary&) = [](const Summary&) { return true; };
};

void PrintTo(const Row& row, std::ostream* stream) {
  *stream << row.field;
}

class OptionsWithoutEffect : public ::testing::TestWithParam<Row> {};

TEST_P(OptionsWithoutEffect, ChangeNothing) {
  EXPECT_TRUE(GetParam().is_told(ExpectNoEffect(GetParam().base, GetParam().change)));
}

const Options kSuiteSparse = With(ceres::SPARSE_SCHUR, ceres::SUITE_SPARSE);
const Options kEigenSparse = With(ceres::SPARSE_NORMAL_CHOLESKY, ceres::EIGEN_SPARSE);

const Row kRows[] = {
    // "Minimizer and line search options"
    {"line_search_direction_type", Small(),
     [](Options* o) { o->line_search_direction_type = ceres::STEEPEST_DESCENT; },
     [](const Summary& s) { return s.line_search_direction_type == ceres::STEEPEST_DESCENT; }},
    {"line_search_direction_type_by_default", Small(), [](Options*) {},
     [](const Summary& s) { return s.line_search_direction_type == ceres::LBFGS; }},
    {"line_search_type", Small(),
     [](Options* o) {
       o->line_search_direction_type = ceres::STEEPEST_DESCENT;
       o->line_search_type = ceres::ARMIJO;
     },
     [](const Summary& s) { return s.line_search_type == ceres::ARMIJO; }},
    {"nonlinear_conjugate_gradient_type", Small(),
     [](Options* o) { o->nonlinear_conjugate_gradient_type = ceres::HESTENES_STIEFEL; },
     [](const Summary& s) {
       return s.nonlinear_conjugate_gradient_type == ceres::HESTENES_STIEFEL;
     }},
    {"max_lbfgs_rank", Small(), [](Options* o) { o->max_lbfgs_rank = 7; },
     [](const Summary& s) { return s.max_lbfgs_rank == 7; }},
    {"use_approximate_eigenvalue_bfgs_scaling", Small(),
     [](Options* o) { o->use_approximate_eigenvalue_bfgs_scaling = true; }},
    {"max_num_line_search_direction_restarts", Small(),
     [](Options* o) { o->max_num_line_search_direction_restarts = 1; }},
    {"line_search_sufficient_curvature_decrease", Small(),
     [](Options* o) { o->line_search_sufficient_curvature_decrease = 0.5; }},
    {"max_line_search_step_expansion", Small(),
     [](Options* o) { o->max_line_search_step_expansion = 2.0; }},
    // "Trust-region options"
    {"eta", Small(), [](Options* o) { o->eta = 0.3; },
     [](const Summary& s) { return s.iterations[0].eta == 0.3 && s.iterations[1].eta == 0.0; }},
    // "Linear solver options"
    {"preconditioner_type", Schur(),
     [](Options* o) { o->preconditioner_type = ceres::SCHUR_JACOBI; },
     [](const Summary& s) {
       return s.preconditioner_type_given == ceres::SCHUR_JACOBI &&
              s.preconditioner_type_used == ceres::SCHUR_JACOBI;
     }},
    {"visibility_clustering_type", Schur(),
     [](Options* o) { o->visibility_clustering_type = ceres::SINGLE_LINKAGE; },
     [](const Summary& s) { return s.visibility_clustering_type == ceres::SINGLE_LINKAGE; }},
    {"dense_linear_algebra_library_type", Schur(),
     [](Options* o) { o->dense_linear_algebra_library_type = ceres::LAPACK; },
     [](const Summary& s) { return s.dense_linear_algebra_library_type == ceres::LAPACK; }},
    {"sparse_linear_algebra_library_type_suite_sparse", kSuiteSparse,
     [](Options* o) { o->sparse_linear_algebra_library_type = ceres::SUITE_SPARSE; },
     [](const Summary& s) { return s.sparse_linear_algebra_library_type == ceres::SUITE_SPARSE; }},
    {"sparse_linear_algebra_library_type_eigen_sparse", kSuiteSparse,
     [](Options* o) { o->sparse_linear_algebra_library_type = ceres::EIGEN_SPARSE; },
     [](const Summary& s) { return s.sparse_linear_algebra_library_type == ceres::EIGEN_SPARSE; }},
    {"use_explicit_schur_complement", Schur(),
     [](Options* o) { o->use_explicit_schur_complement = true; }},
    {"max_num_refinement_iterations", kEigenSparse,
     [](Options* o) { o->max_num_refinement_iterations = 3; }},
    {"min_linear_solver_iterations", Schur(),
     [](Options* o) { o->min_linear_solver_iterations = 5; }},
    {"max_linear_solver_iterations", Schur(),
     [](Options* o) { o->max_linear_solver_iterations = 1; }},
#if CERES_VERSION_MINOR < 2
    {"sparse_linear_algebra_library_type_cx_sparse", kSuiteSparse,
     [](Options* o) { o->sparse_linear_algebra_library_type = ceres::CX_SPARSE; },
     [](const Summary& s) { return s.sparse_linear_algebra_library_type == ceres::CX_SPARSE; }},
    {"use_postordering", kSuiteSparse, [](Options* o) { o->use_postordering = true; }},
#else
    {"linear_solver_ordering_type_by_default", With(ceres::SPARSE_SCHUR, ceres::EIGEN_SPARSE),
     [](Options*) {}, [](const Summary& s) { return s.linear_solver_ordering_type == ceres::AMD; }},
    {"linear_solver_ordering_type", With(ceres::DENSE_SCHUR, ceres::EIGEN_SPARSE),
     [](Options* o) { o->linear_solver_ordering_type = ceres::NESDIS; },
     [](const Summary& s) { return s.linear_solver_ordering_type == ceres::NESDIS; }},
    {"options_of_the_power_series_preconditioner", Schur(),
     [](Options* o) {
       o->max_num_spse_iterations = 7;
       o->use_spse_initialization = true;
       o->spse_tolerance = 0.5;
     }},
#endif
    // "Callback and logging options"
    {"gradient_check_numeric_derivative_relative_step_size", Small(),
     [](Options* o) { o->gradient_check_numeric_derivative_relative_step_size = 1e-4; }},
};

INSTANTIATE_TEST_SUITE_P(Contract, OptionsWithoutEffect, ::testing::ValuesIn(kRows),
                         [](const auto& row) { return std::string(row.param.field); });

// What has an effect of "Minimizer and line search options". Those of the search along a step for
// bounds are next to stock in adapters/bounds_test.cc.

TEST(Options21, minimizer_type) {
  for (const auto type : {ceres::TRUST_REGION, ceres::LINE_SEARCH}) {
    Line line;
    Options options = Small();
    options.minimizer_type = type;
    const Solver solver = type == ceres::TRUST_REGION ? Solver::kOurs : Solver::kAnyone;
    const Summary summary = Solve(options, &line.problem, solver).summary;
    EXPECT_EQ(summary.minimizer_type, type);
    EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE);
    EXPECT_NEAR(line.x[0], 10.0, 1e-6);
  }
}

// Validated whatever the minimizer: (L)BFGS requires WOLFE.
TEST(Options21, line_search_type) {
  Line line;
  Options options = Small();
  options.line_search_type = ceres::ARMIJO;
  const Outcome outcome = Solve(options, &line.problem);
  EXPECT_EQ(outcome.summary.termination_type, ceres::FAILURE);
  EXPECT_EQ(line.x[0], 0.5);
}

}  // namespace
}  // namespace conformance
