// The batch solver and graphs that edits have changed: neither free places nor removed variables
// matter.
#include <gtest/gtest.h>

#include "inceres/problem/graph_edit.h"
#include "inceres/solver/solver.h"
#include "support/test_families.h"

namespace inceres::test {
namespace {

class EditedGraph : public testing::Test {
 protected:
  // x_0 … x_3, each drawn to its index, neighbors drawn to each other.
  EditedGraph() {
    const double zero = 0.0;
    for (int i = 0; i < 4; ++i) {
      graph_.AddVariable(&zero, 1, Role::kFrame);
      graph_.AddFactor(priors_, 0, {i});
      if (i > 0) {
        graph_.AddFactor(pairs_, 0, {i - 1, i});
      }
    }
  }

  FactorGraph graph_;
  FamilyHandle<FunctionFamily> priors_ =
      graph_.AddFamily(ScalarFamily([](int i, double x) { return x - i; }, 1.0));
  FamilyHandle<FunctionFamily> pairs_ =
      graph_.AddFamily(ScalarFamily([](double a, double b) { return 2.0 * (a - b); }, 2.0, -2.0));
};

TEST_F(EditedGraph, FreePlacesAreEmptyAndFilledOnesSolved) {
  FactorGraph untouched = graph_;
  GraphEdit edit(graph_);
  edit.RemoveFactor({pairs_, 1});
  edit.RemoveFactor({pairs_, 0});
  ASSERT_TRUE(graph_.Apply(edit).ok());
  const Summary gaps = Solve(SolverOptions(), &graph_);
  ASSERT_TRUE(gaps.IsSolutionUsable()) << gaps.message;
  // x_0 and x_1 are drawn by their priors alone; x_2 − 2 + 4 (x_2 − x_3) = 0, x_3 − 3 + 4 (x_3 −
  // x_2) = 0.
  const double expected[4] = {0.0, 1.0, 2.0 + 4.0 / 9.0, 3.0 - 4.0 / 9.0};
  for (int i = 0; i < 4; ++i) {
    EXPECT_NEAR(*graph_.Values(i), expected[i], 1e-6) << i;
  }

  edit.Restart();
  edit.AddFactor(pairs_, 0, {0, 1});
  edit.AddFactor(pairs_, 0, {1, 2});
  const double zero = 0.0;
  for (int i = 0; i < 4; ++i) {
    edit.SetValues(i, &zero);
  }
  ASSERT_TRUE(graph_.Apply(edit).ok());
  ASSERT_TRUE(Solve(SolverOptions(), &graph_).IsSolutionUsable());
  ASSERT_TRUE(Solve(SolverOptions(), &untouched).IsSolutionUsable());
  EXPECT_EQ(graph_.state(), untouched.state());
}

TEST_F(EditedGraph, RemovedVariablesDoNotMatter) {
  FactorGraph untouched = graph_;
  const double values[2] = {1.0, 2.0};
  GraphEdit edit(graph_);
  const VariableId free = edit.AddVariable(values, 2, Role::kLandmark);
  const VariableId borrowed = edit.AddBorrowedConstant(values, 2);
  ASSERT_TRUE(graph_.Apply(edit).ok());
  edit.Restart();
  edit.RemoveVariable(free);
  edit.RemoveVariable(borrowed);
  ASSERT_TRUE(graph_.Apply(edit).ok());
  const Summary summary = Solve(SolverOptions(), &graph_);
  ASSERT_TRUE(summary.IsSolutionUsable()) << summary.message;
  ASSERT_TRUE(Solve(SolverOptions(), &untouched).IsSolutionUsable());
  EXPECT_LT(summary.final_cost, summary.initial_cost);
  EXPECT_TRUE(
      std::equal(untouched.state().begin(), untouched.state().end(), graph_.state().begin()));
}

// A factor's id does not reach another one that was given its place.
TEST_F(EditedGraph, ASubsetThatNamesARemovedFactorIsRefused) {
  GraphEdit edit(graph_);
  edit.RemoveFactor({pairs_, 2});
  ASSERT_TRUE(graph_.Apply(edit).ok());
  edit.Restart();
  const FactorId first = edit.AddFactor(pairs_, 0, {0, 3});
  ASSERT_TRUE(graph_.Apply(edit).ok());
  edit.Restart();
  edit.RemoveFactor(first);
  ASSERT_TRUE(graph_.Apply(edit).ok());
  edit.Restart();
  const FactorId second = edit.AddFactor(pairs_, 0, {2, 3});
  ASSERT_TRUE(graph_.Apply(edit).ok());
  ASSERT_EQ(first.index, second.index);
  SolverOptions options;
  options.linear_model = LinearModelKind::kIterativePlain;
  options.conjugate_gradients.preconditioner = PreconditionerKind::kSubset;
  for (const FactorId& id : {first, second, FactorId{pairs_, 2}}) {
    options.conjugate_gradients.subset =
        std::make_shared<const std::vector<FactorId>>(std::vector<FactorId>{id});
    const Summary summary = Solve(options, &graph_);
    EXPECT_EQ(summary.IsSolutionUsable(), id.generation != first.generation) << summary.message;
  }
  options.conjugate_gradients.subset =
      std::make_shared<const std::vector<FactorId>>(std::vector<FactorId>{first});
  const std::string message = Solve(options, &graph_).message;
  EXPECT_NE(message.find("subset names a factor that is not there"), std::string::npos) << message;
}

}  // namespace
}  // namespace inceres::test
