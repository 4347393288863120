// A user's own reduced solver through SolverOptions, as docs/reduced_solver.md shows it.
#include <memory>

#include <gtest/gtest.h>

#include "inceres/solver/solver.h"
#include "linear/counting_solver.h"
#include "linear/eigen_ldlt_solver.h"
#include "support/random_graph.h"

namespace inceres {
namespace {

using test::BundleOptions;
using test::CountingSolver;
using test::MakeBundle;

// [quoted in docs/reduced_solver.md]
SolverOptions OptionsWithOwnSolver() {
  SolverOptions options;
  options.reduced_solver_factory = [] { return std::make_unique<EigenLdltSolver>(); };
  return options;
}
// [end of quote]

BundleOptions Problem() {
  BundleOptions options;
  options.perturbation = 0.3;
  return options;
}

TEST(CustomReducedSolver, GivesTheSameResultAsTheBuiltIn) {
  const auto ours = MakeBundle(Problem());
  const auto theirs = MakeBundle(Problem());
  SolverOptions tight;
  tight.function_tolerance = 1e-14;
  const Summary expected = Solve(tight, &ours->graph());
  SolverOptions options = OptionsWithOwnSolver();
  options.function_tolerance = 1e-14;
  const Summary summary = Solve(options, &theirs->graph());
  ASSERT_EQ(expected.termination, Termination::kConvergence) << expected.message;
  EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
  EXPECT_EQ(summary.reduced_solver, "Eigen LDLT");
  EXPECT_NE(expected.reduced_solver, "Eigen LDLT");
  EXPECT_EQ(summary.iterations.size(), expected.iterations.size());
  EXPECT_NEAR(summary.final_cost, expected.final_cost, 1e-10 * expected.final_cost);
  for (std::size_t k = 0; k < ours->graph().state().size(); ++k) {
    EXPECT_NEAR(theirs->graph().state()[k], ours->graph().state()[k], 1e-6);
  }
}

Summary SolveCounting(CountingSolver::Record* record, FactorGraph* graph) {
  SolverOptions options;
  options.reduced_solver_factory = test::MakesCountingSolvers(record);
  return Solve(options, graph);
}

TEST(CustomReducedSolver, IsAnalysedOnceAndFactoredForEveryLinearSolve) {
  const auto bundle = MakeBundle(Problem());
  CountingSolver::Record record;
  const Summary summary = SolveCounting(&record, &bundle->graph());
  ASSERT_EQ(summary.termination, Termination::kConvergence) << summary.message;
  EXPECT_EQ(record.num_analyses, 1);
  EXPECT_GT(record.num_factorizations, 0);
  EXPECT_EQ(record.num_factorizations, summary.work.num_linear_solves);
  EXPECT_EQ(record.num_solves, record.num_factorizations);
}

TEST(CustomReducedSolver, AFailedAnalysisFailsTheSolveAndLeavesTheState) {
  const auto bundle = MakeBundle(Problem());
  const std::vector<double> state = bundle->graph().state();
  CountingSolver::Record record;
  record.analysis = Status::Error(StatusCode::kUnavailable, "no license");
  const Summary summary = SolveCounting(&record, &bundle->graph());
  EXPECT_EQ(summary.termination, Termination::kFailure);
  EXPECT_NE(summary.message.find("no license"), std::string::npos) << summary.message;
  EXPECT_EQ(bundle->graph().state(), state);
  EXPECT_EQ(record.num_factorizations, 0);
}

// kSingular means "more damping, please"; anything else ends the solve at once.
TEST(CustomReducedSolver, SingularIsAnInvalidStepOtherErrorsAreFatal) {
  const auto bundle = MakeBundle(Problem());
  const std::vector<double> state = bundle->graph().state();
  CountingSolver::Record record;
  record.factorization = Status::Error(StatusCode::kSingular, "not today");
  Summary summary = SolveCounting(&record, &bundle->graph());
  EXPECT_EQ(summary.termination, Termination::kFailure);
  EXPECT_EQ(record.num_factorizations, SolverOptions().max_num_consecutive_invalid_steps);
  EXPECT_NE(summary.message.find("consecutive invalid steps"), std::string::npos)
      << summary.message;
  EXPECT_EQ(summary.detail, "not today");
  EXPECT_EQ(bundle->graph().state(), state);

  record = {};
  record.factorization = Status::Error(StatusCode::kUnavailable, "the GPU is gone");
  summary = SolveCounting(&record, &bundle->graph());
  EXPECT_EQ(summary.termination, Termination::kFailure);
  EXPECT_EQ(record.num_factorizations, 1);
  EXPECT_EQ(summary.message,
            "Linear solver failed due to unrecoverable non-numeric causes. Please see the error "
            "log for clues. ");
  EXPECT_EQ(summary.detail, "the GPU is gone");
  EXPECT_EQ(bundle->graph().state(), state);
}

TEST(CustomReducedSolver, AFactoryThatReturnsNullFailsTheSolve) {
  const auto bundle = MakeBundle(Problem());
  const std::vector<double> state = bundle->graph().state();
  SolverOptions options;
  options.reduced_solver_factory = [] { return std::unique_ptr<ReducedSolver>(); };
  const Summary summary = Solve(options, &bundle->graph());
  EXPECT_EQ(summary.termination, Termination::kFailure);
  EXPECT_NE(summary.message.find("reduced_solver_factory"), std::string::npos) << summary.message;
  EXPECT_EQ(bundle->graph().state(), state);
}

}  // namespace
}  // namespace inceres
