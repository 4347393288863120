// ITERATIVE_SCHUR and CGNR in incremental mode: conjugate gradients where the reduced system is
// large, a direct solver else.
#include <gtest/gtest.h>

#include "adapters/ceres/plan/option_mapping.h"
#include "adapters/compare_with_stock.h"
#include "adapters/session_support.h"
#include "inceres/ceres/session.h"

namespace inceres {
namespace {

using internal::ChooseIterativeSolver;
using testing::MakeBundle;
using testing::TargetCost;
using testing::TestProblem;
using Options = ceres::Solver::Options;

// 4 variable cameras of 9: 36 unknowns when the points are eliminated.
IncrementalOptions Chosen(ceres::LinearSolverType type, int max_direct_size,
                          const IncrementalOptions& core = IncrementalOptions()) {
  const auto test = MakeBundle(5, 60, true);
  Options options;
  options.linear_solver_type = type;
  const internal::ProblemView view = internal::Introspect(test->problem);
  IncrementalOptions result = core;
  ChooseIterativeSolver(options, view, internal::ReadOrdering(options, view), max_direct_size,
                        &result);
  return result;
}

TEST(IterativeChoice, GoesByTheSizeOfTheReducedSystem) {
  const double share = IncrementalOptions().batch_share;
  for (const ceres::LinearSolverType type : {ceres::ITERATIVE_SCHUR, ceres::CGNR}) {
    EXPECT_EQ(Chosen(type, 36).reduced_solver, ReducedSolverKind::kAutomatic);
    EXPECT_EQ(Chosen(type, 36).batch_share, share);
    EXPECT_EQ(Chosen(type, 35).reduced_solver, ReducedSolverKind::kPcg);
  }
  EXPECT_EQ(Chosen(ceres::CGNR, 35).batch_share, 1.0) << "no factorization by the batch solver";
  const IncrementalOptions schur = Chosen(ceres::ITERATIVE_SCHUR, 35);
  EXPECT_EQ(schur.batch_share, share);
  EXPECT_EQ(schur.batch_reduced_solver, ReducedSolverKind::kAutomaticInexact);
  EXPECT_TRUE(schur.batch_conjugate_gradients.eta_follows_gradient);
  // 216 unknowns in all
  EXPECT_EQ(Chosen(ceres::ITERATIVE_SCHUR, 215).batch_reduced_solver,
            ReducedSolverKind::kAutomaticInexact);
  EXPECT_EQ(Chosen(ceres::ITERATIVE_SCHUR, 215).reduced_solver, ReducedSolverKind::kAutomatic);
  EXPECT_EQ(Chosen(ceres::ITERATIVE_SCHUR, 216).batch_reduced_solver,
            ReducedSolverKind::kAutomatic);
  EXPECT_EQ(Chosen(ceres::DENSE_SCHUR, 35).reduced_solver, ReducedSolverKind::kAutomatic);
}

TEST(IterativeChoice, LeavesWhatTheCallerChose) {
  IncrementalOptions core;
  core.reduced_solver = ReducedSolverKind::kResumed;
  EXPECT_EQ(Chosen(ceres::ITERATIVE_SCHUR, 35, core).reduced_solver, ReducedSolverKind::kResumed);
  core.reduced_solver = ReducedSolverKind::kAutomatic;
  core.batch_share = 0.0;
  EXPECT_EQ(Chosen(ceres::ITERATIVE_SCHUR, 35, core).batch_share, 0.0)
      << "every solve by the batch solver, as asked for";
}

// b − a − target, of size 6.
ceres::CostFunction* TieCost(double target) {
  return new lambdas::Formula(
      6, {6, 6}, [=](double const* const* x, double* residuals, double** jacobians) {
        for (int r = 0; r < 6; ++r) {
          residuals[r] = x[1][r] - x[0][r] - target + 0.1 * std::sin(x[1][r]);
          jacobians[0][7 * r] = -1.0;
          jacobians[1][7 * r] = 1.0 + 0.1 * std::cos(x[1][r]);
        }
        return true;
      });
}

// 1,400 frames in a row: 8,400 unknowns.
std::unique_ptr<TestProblem> MakeChain() {
  auto test = std::make_unique<TestProblem>();
  double* last = nullptr;
  for (int i = 0; i < 1400; ++i) {
    double* next = test->Add(std::vector<double>(6, 0.1 * (i % 7)));
    test->problem.AddResidualBlock(new TargetCost(std::vector<double>(6, 0.01 * (i % 11))), nullptr,
                                   next);
    if (last != nullptr) {
      test->problem.AddResidualBlock(TieCost(0.02 * (i % 5)), nullptr, last, next);
    }
    last = next;
  }
  return test;
}

TEST(IterativeSolvers, EndWhereStockDoes) {
  for (const bool large : {true, false}) {
    for (const ceres::LinearSolverType type : {ceres::ITERATIVE_SCHUR, ceres::CGNR}) {
      SCOPED_TRACE(ceres::LinearSolverTypeToString(type));
      const auto make = [large] { return large ? MakeChain() : MakeBundle(5, 60, true); };
      Options options;
      options.linear_solver_type = type;
      options.logging_type = ceres::SILENT;
      options.max_num_iterations = 200;
      const auto stock = make();
      Options tight = options;
      tight.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
      tight.function_tolerance = tight.gradient_tolerance = tight.parameter_tolerance = 1e-14;
      ceres::Solver::Summary expected;
      ceres::Solve(tight, &stock->problem, &expected);
      const auto ours = make();
      ceres::Solver::Summary summary;
      SolveOptions asked;
      SolveReport report;
      asked.mode = SolveMode::kIncremental;
      asked.strict = true;
      Solve(options, &ours->problem, &summary, asked, &report);
      EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE) << summary.message;
      EXPECT_NEAR(summary.final_cost, expected.final_cost, 1e-6 * expected.final_cost);
      EXPECT_EQ(summary.linear_solver_type_given, type);
      EXPECT_EQ(summary.linear_solver_type_used, type);
      EXPECT_EQ(report.update.num_pcg_iterations > 0, large);
      ASSERT_GT(summary.iterations.size(), 1U);
      EXPECT_EQ(summary.iterations[1].linear_solver_iterations > 1, large)
          << "1 tells of a direct solver";
    }
  }
}

// 8,472 unknowns with points to eliminate.
TEST(IterativeSolvers, TheirEndIsTheUsersInTheBatchSolver) {
  const auto test = MakeBundle(5, 2812, true);
  Options options;
  options.linear_solver_type = ceres::ITERATIVE_SCHUR;
  options.preconditioner_type = ceres::SCHUR_JACOBI;
  options.logging_type = ceres::SILENT;
  options.max_num_iterations = 1;
  options.eta = 0.5;
  options.max_linear_solver_iterations = 50;
  ceres::Solver::Summary summary;
  SolveOptions asked;
  SolveReport report;
  asked.mode = SolveMode::kIncremental;
  Solve(options, &test->problem, &summary, asked, &report);
  EXPECT_TRUE(summary.IsSolutionUsable()) << summary.message;
  EXPECT_EQ(report.options_without_effect, std::vector<std::string>{"preconditioner_type"});
  // Unless told otherwise.
  asked.conjugate_gradients = ConjugateGradientsOptions();
  Solve(options, &test->problem, &summary, asked, &report);
  EXPECT_EQ(
      report.options_without_effect,
      (std::vector<std::string>{"eta", "max_linear_solver_iterations", "preconditioner_type"}));
}

TEST(IterativeSolvers, ASessionSolvesAgainWithTheOtherKind) {
  const auto test = MakeChain();
  Options options;
  options.logging_type = ceres::SILENT;
  CeresSession session{inceres::testing::AlwaysIncremental()};
  ceres::Solver::Summary summary;
  SolveReport report;
  for (const ceres::LinearSolverType type :
       {ceres::SPARSE_NORMAL_CHOLESKY, ceres::CGNR, ceres::CGNR}) {
    options.linear_solver_type = type;
    for (std::size_t b = 0; b < 20; ++b) {
      test->blocks[b][0] += 0.5;
    }
    session.Solve(options, &test->problem, &summary, {}, &report);
    EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE) << summary.message;
    EXPECT_FALSE(report.used_stock);
    EXPECT_EQ(report.update.num_pcg_iterations > 0, type == ceres::CGNR);
  }
  EXPECT_GT(report.changes.num_kept_factors, 2000) << "the third solve goes on from the second";
}

}  // namespace
}  // namespace inceres
