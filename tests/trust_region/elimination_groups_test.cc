// Frames of a batch solve in groups: the factor eliminates them in that order, and finds the same
// optimum.
#include <algorithm>
#include <set>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/solver/solver.h"
#include "linear/group_pairs.h"
#include "support/random_graph.h"
#include "trust_region/solver_way.h"

namespace inceres {
namespace {

using test::MakeBundle;

test::BundleOptions Eighty() {
  return test::MixedBundle(80);
}

// Frames that a factor ties, or a landmark that both see.
std::vector<std::set<int>> CoupledFrames(const FactorGraph& graph) {
  std::vector<std::set<int>> seen(static_cast<std::size_t>(graph.num_variables()));
  std::vector<std::set<int>> coupled = seen;
  const auto couple = [&coupled](const std::set<int>& frames) {
    for (const int a : frames) {
      for (const int b : frames) {
        if (a != b) {
          coupled[static_cast<std::size_t>(a)].insert(b);
        }
      }
    }
  };
  for (FamilyId id = 0; id < graph.num_families(); ++id) {
    const int num_slots = graph.family(id).num_slots();
    for (int factor = 0; factor < graph.NumFactors(id); ++factor) {
      std::set<int> frames;
      int landmark = -1;
      for (int s = 0; s < num_slots; ++s) {
        const VariableId variable = graph.Variables(id, factor)[s];
        if (graph.IsConstant(variable)) {
          continue;
        }
        if (graph.role(variable) == Role::kLandmark) {
          landmark = variable;
        } else {
          frames.insert(variable);
        }
      }
      if (landmark >= 0) {
        seen[static_cast<std::size_t>(landmark)].insert(frames.begin(), frames.end());
      } else {
        couple(frames);
      }
    }
  }
  std::for_each(seen.begin(), seen.end(), couple);
  return coupled;
}

std::vector<int> GroupsOf(const FactorGraph& graph) {
  std::vector<int> groups;
  for (VariableId id = 0; id < graph.num_variables(); ++id) {
    groups.push_back(graph.elimination_group(id));
  }
  return groups;
}

class EliminationGroups : public testing::TestWithParam<ReducedSolverKind> {};

TEST_P(EliminationGroups, TheOrderIsKeptAndTheOptimumTheSame) {
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
  EXPECT_EQ(static_cast<int>(order.size()), summary.work.num_frames);
  EXPECT_EQ(internal::CountMisplaced(order, CoupledFrames(graph), GroupsOf(graph)), 0);
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
