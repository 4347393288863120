// Solves with Jacobians in single precision: they end where those in double do, in less memory, and
// with the same bits for any number of threads.
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/solver/incremental_solver.h"
#include "inceres/solver/solver.h"
#include "support/random_graph.h"

namespace inceres {
namespace {

std::unique_ptr<test::RandomGraph> Bundle() {
  test::BundleOptions bundle;
  bundle.num_frames = 20;
  bundle.num_landmarks = 3000;
  bundle.num_views = 5;
  bundle.losses = bundle.constants = true;
  bundle.perturbation = 0.1;
  return test::MakeBundle(bundle);
}

SolverOptions Options(PreconditionerKind preconditioner, bool single) {
  SolverOptions options;
  options.linear_model = LinearModelKind::kIterativeSchur;
  options.conjugate_gradients.preconditioner = preconditioner;
  options.conjugate_gradients.eta = 1e-4;
  options.conjugate_gradients.single_precision_jacobians = single;
  options.max_num_iterations = 100;
  return options;
}

class SinglePrecisionSolve : public ::testing::TestWithParam<PreconditionerKind> {};

TEST_P(SinglePrecisionSolve, EndsWhereOneInDoubleDoes) {
  for (const double tolerance : {1e-6, 1e-10}) {
    const auto in_double = Bundle(), in_single = Bundle();
    SolverOptions options = Options(GetParam(), false);
    options.function_tolerance = tolerance;
    const Summary expected = Solve(options, &in_double->graph());
    options.conjugate_gradients.single_precision_jacobians = true;
    const Summary summary = Solve(options, &in_single->graph());
    ASSERT_EQ(expected.termination, Termination::kConvergence) << expected.message;
    EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
    EXPECT_EQ(summary.initial_cost, expected.initial_cost);
    EXPECT_LT(summary.final_cost, 0.9 * summary.initial_cost);
    EXPECT_NEAR(summary.final_cost, expected.final_cost, tolerance * expected.final_cost);
    EXPECT_LT(summary.work.bytes, expected.work.bytes);
  }
}

INSTANTIATE_TEST_SUITE_P(Preconditioners, SinglePrecisionSolve,
                         ::testing::Values(PreconditionerKind::kIdentity,
                                           PreconditionerKind::kJacobi,
                                           PreconditionerKind::kSchurJacobi,
                                           PreconditionerKind::kClusterTridiagonal,
                                           PreconditionerKind::kTwoLevel));

TEST(SinglePrecisionSolves, FitWhereThoseInDoubleDoNot) {
  const auto bundle = Bundle();
  SolverOptions options = Options(PreconditionerKind::kJacobi, true);
  const Summary free = Solve(options, &bundle->graph());
  ASSERT_TRUE(free.IsSolutionUsable()) << free.message;
  // Between the two there is a budget that one fits into and the other does not.
  int num_told_apart = 0;
  for (double share = 1.0; share < 2.0; share += 0.05) {
    const auto of = [&](bool single) {
      options.conjugate_gradients.single_precision_jacobians = single;
      options.max_memory_bytes =
          static_cast<std::int64_t>(share * static_cast<double>(free.work.bytes));
      return Solve(options, &Bundle()->graph()).IsSolutionUsable();
    };
    const bool single = of(true), in_double = of(false);
    EXPECT_TRUE(single || !in_double);
    num_told_apart += single && !in_double ? 1 : 0;
  }
  EXPECT_GT(num_told_apart, 0);
}

TEST(SinglePrecisionSolves, AreOfConjugateGradientsWithLandmarksOnly) {
  SolverOptions options;
  options.conjugate_gradients.single_precision_jacobians = true;
  for (const LinearModelKind model :
       {LinearModelKind::kAutomatic, LinearModelKind::kSchur, LinearModelKind::kIterativePlain}) {
    options.linear_model = model;
    EXPECT_NE(options.Validate().message.find("single_precision_jacobians"), std::string::npos);
  }
  options.linear_model = LinearModelKind::kIterativeSchur;
  EXPECT_TRUE(options.Validate().ok());
  IncrementalOptions incremental;
  incremental.batch_conjugate_gradients.single_precision_jacobians = true;
  EXPECT_FALSE(incremental.Validate().ok());
  incremental.batch_linear_model = LinearModelKind::kIterativeSchur;
  EXPECT_TRUE(incremental.Validate().ok());
}

// A factor that fails in the second strip is named as it is in double.
TEST(SinglePrecisionSolves, NameAFactorThatFailsAsThoseInDoubleDo) {
  std::string details[2];
  for (const bool single : {false, true}) {
    const auto bundle = Bundle();
    FactorGraph& graph = bundle->graph();
    const VariableId last = graph.num_variables() - 1;
    const std::vector<double> broken(static_cast<std::size_t>(graph.AmbientSize(last)),
                                     std::nan(""));
    graph.SetValues(last, broken.data());
    const Summary summary = Solve(Options(PreconditionerKind::kJacobi, single), &graph);
    EXPECT_EQ(summary.termination, Termination::kFailure);
    details[single ? 1 : 0] = summary.message + summary.detail;
  }
  EXPECT_EQ(details[0], details[1]);
}

}  // namespace
}  // namespace inceres
