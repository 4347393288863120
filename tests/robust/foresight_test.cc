// Foresight against solves: the errors that suspects have when they weigh something.
#include "robust/foresight.h"

#include <cstddef>
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/problem/losses.h"
#include "robust/gnc_worlds.h"
#include "robust/squared_errors.h"

namespace inceres::internal {
namespace {

using test::GncWorld;
using test::PoseGraphWorld;

// The same factors in a living solver, family by family and in their order: ids are the graph's.
void Load(const FactorGraph& graph, IncrementalSolver* solver) {
  for (FamilyId id = 0; id < graph.num_families(); ++id) {
    const std::shared_ptr<const FactorFamily> family(std::shared_ptr<void>(), &graph.family(id));
    ASSERT_EQ(solver->AddFamily(family), id);
  }
  GraphEdit edit(solver->graph());
  for (VariableId id = 0; id < graph.num_variables(); ++id) {
    edit.AddVariable(graph.Values(id), graph.AmbientSize(id), graph.role(id),
                     graph.shared_manifold(id));
    edit.SetConstant(id, graph.IsConstant(id));
  }
  for (FamilyId id = 0; id < graph.num_families(); ++id) {
    for (int i = 0; i < graph.NumFactors(id); ++i) {
      edit.Connect(id, graph.Variables(id, i));
    }
  }
  const Status applied = solver->Apply(edit);
  ASSERT_TRUE(applied.ok()) << applied.message;
}

// A world at the solution of everything but some of its right loops, whose errors are small enough
// for first order.
class ForeseenWorld {
 public:
  explicit ForeseenWorld(int dimension) : made_(PoseGraphWorld(dimension, 60, 20, 0, 0.002, 3)) {
    options_.function_tolerance = 1e-12;
    suspects_ = {made_.suspects[3], made_.suspects[4], made_.suspects[11]};
  }

  std::vector<double> ErrorsWith(const std::vector<double>& weights, IncrementalSolver* solver) {
    GraphEdit edit(solver->graph());
    for (std::size_t k = 0; k < suspects_.size(); ++k) {
      edit.SetLoss(suspects_[k], std::make_shared<ScaledLoss>(nullptr, weights[k]));
    }
    EXPECT_TRUE(solver->Apply(edit).ok());
    EXPECT_EQ(solver->Update().termination, Termination::kConvergence);
    std::vector<double> errors;
    EXPECT_TRUE(
        SquaredErrors(
            solver->graph(), suspects_, [&](VariableId id) { return solver->Values(id); }, &errors)
            .ok());
    return errors;
  }

  void Expect() {
    IncrementalSolver solver(options_);
    ASSERT_NO_FATAL_FAILURE(Load(made_.graph, &solver));
    const std::vector<double> none(suspects_.size(), 0.0);
    const std::vector<double> before = ErrorsWith(none, &solver);
    Foresight foresight;
    const Status prepared = foresight.Prepare(solver, suspects_);
    ASSERT_TRUE(prepared.ok()) << prepared.message;
    for (const std::vector<double>& weights :
         {none, std::vector<double>{1.0, 0.0, 0.0}, std::vector<double>{0.2, 1.0, 0.5}}) {
      const std::vector<double> foreseen = foresight.SquaredErrors(weights);
      const std::vector<double> found = ErrorsWith(weights, &solver);
      for (std::size_t k = 0; k < found.size(); ++k) {
        EXPECT_NEAR(foreseen[k], found[k], 0.03 * before[k]) << k;
      }
    }
  }

 private:
  GncWorld made_;
  IncrementalOptions options_;
  std::vector<FactorId> suspects_;
};

TEST(Foresight, KnowsTheErrorsOfPlanarLoops) {
  ForeseenWorld(2).Expect();
}

TEST(Foresight, KnowsTheErrorsOfSpatialLoops) {
  ForeseenWorld(3).Expect();
}

// Without a gauge there is no covariance, and nothing is foreseen.
TEST(Foresight, FailsWhereThereIsNoCovariance) {
  GncWorld made(PoseGraphWorld(2, 30, 10, 0, 0.01, 3));
  made.graph.SetConstant(made.ids.poses[0], false);
  IncrementalSolver solver{IncrementalOptions()};
  ASSERT_NO_FATAL_FAILURE(Load(made.graph, &solver));
  solver.Update();
  Foresight foresight;
  EXPECT_FALSE(foresight.Prepare(solver, {made.suspects[0]}).ok());
}

}  // namespace
}  // namespace inceres::internal
