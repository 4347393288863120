// Frames of a batch solve in groups: they come to the factor, which finds the same optimum. (That
// it keeps to them: BatchGroups.)
#include <gtest/gtest.h>

#include "inceres/solver/solver.h"
#include "support/random_graph.h"
#include "trust_region/solver_way.h"

namespace inceres {
namespace {

using test::MakeBundle;

test::BundleOptions Eighty() {
  return test::MixedBundle(80);
}

class EliminationGroups : public testing::TestWithParam<ReducedSolverKind> {};

TEST_P(EliminationGroups, TheOptimumIsTheSame) {
  SolverOptions options;
  options.reduced_solver = GetParam();
  const auto plain = MakeBundle(Eighty());
  const Summary expected = Solve(options, &plain->graph());
  ASSERT_EQ(expected.termination, Termination::kConvergence) << expected.message;

  const auto bundle = MakeBundle(Eighty());
  FactorGraph& graph = bundle->graph();
  int num_frames = 0;
  for (VariableId id = 0; id < graph.num_variables(); ++id) {
    if (graph.role(id) == Role::kFrame && !graph.IsConstant(id)) {
      graph.SetEliminationGroup(id, (num_frames++ * 5) % 3);
    }
  }
  Solver solver;
  const Summary summary = solver.Solve(options, &graph);
  ASSERT_EQ(summary.termination, Termination::kConvergence) << summary.message;
  EXPECT_NEAR(summary.final_cost, expected.final_cost, 1e-9 * expected.final_cost);
  EXPECT_EQ(summary.iterations.size(), expected.iterations.size());
  const std::vector<VariableId> order = solver.EliminationOrder();
  ASSERT_EQ(static_cast<int>(order.size()), summary.work.num_frames);
  EXPECT_EQ(graph.elimination_group(order.back()), 2) << "the last group comes last";
}

INSTANTIATE_TEST_SUITE_P(Kinds, EliminationGroups,
                         testing::Values(ReducedSolverKind::kAutomatic, ReducedSolverKind::kDense,
                                         ReducedSolverKind::kSparse));

TEST(EliminationGroup, AnotherOneIsAnotherStructure) {
  const auto bundle = MakeBundle(Eighty());
  FactorGraph& graph = bundle->graph();
  Solver solver;
  solver.Solve(SolverOptions(), &graph);
  EXPECT_TRUE(solver.IsReadyFor(SolverOptions(), graph));
  const VariableId first = solver.EliminationOrder().front();
  graph.SetEliminationGroup(first, 1);
  EXPECT_TRUE(graph.HasEliminationGroups());
  EXPECT_FALSE(solver.IsReadyFor(SolverOptions(), graph));
  solver.Solve(SolverOptions(), &graph);
  EXPECT_EQ(solver.EliminationOrder().back(), first) << "the only one of its group comes last";
  EXPECT_TRUE(solver.IsReadyFor(SolverOptions(), graph));
  graph.SetEliminationGroup(first, 2);
  EXPECT_FALSE(solver.IsReadyFor(SolverOptions(), graph));
  graph.SetEliminationGroup(first, 0);
  EXPECT_FALSE(graph.HasEliminationGroups());
}

TEST(EliminationGroup, BelowZeroIsRefusedByName) {
  const auto bundle = MakeBundle(Eighty());
  bundle->graph().SetEliminationGroup(2, -3);
  const Summary summary = Solve(SolverOptions(), &bundle->graph());
  EXPECT_EQ(summary.termination, Termination::kFailure);
  EXPECT_EQ(summary.message, "variable 2 is in the elimination group -3; groups are 0 or above");
}

TEST(EliminationGroup, NoFactorNoOrder) {
  const auto bundle = MakeBundle(Eighty());
  EXPECT_TRUE(Solver().EliminationOrder().empty()) << "nothing was solved";
  SolverOptions options;
  options.linear_model = LinearModelKind::kIterativeSchur;
  Solver solver;
  solver.Solve(options, &bundle->graph());
  EXPECT_TRUE(solver.EliminationOrder().empty()) << "conjugate gradients";
}

}  // namespace
}  // namespace inceres
