// A problem that is filled photo by photo is the one that is filled point by point.
#include <algorithm>
#include <cmath>
#include <tuple>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/io/bal_graph.h"
#include "inceres/solver/solver.h"
#include "tools/sim/collection_scene.h"

namespace inceres {
namespace {

SimulatedBal Photos() {
  CollectionOptions options;
  EXPECT_TRUE(GetCollectionPreset("collection-20", &options).ok());
  options.outlier_fraction = 0.1;
  SimulatedBal scene;
  EXPECT_TRUE(GenerateCollection(options, nullptr, &scene).ok());
  return scene;
}

std::vector<std::tuple<int, int, double, double>> OutliersOf(const SimulatedBal& scene) {
  std::vector<std::tuple<int, int, double, double>> outliers;
  for (const int k : scene.outliers) {
    const BalObservation& o = scene.problem.observations[static_cast<std::size_t>(k)];
    outliers.emplace_back(o.camera, o.point, o.x, o.y);
  }
  std::sort(outliers.begin(), outliers.end());
  return outliers;
}

TEST(PhotoOrder, SortingByCameraKeepsObservationsAndOutliers) {
  const SimulatedBal scene = Photos();
  SimulatedBal sorted = scene;
  sorted.SortByCamera();
  const auto& observations = sorted.problem.observations;
  ASSERT_EQ(observations.size(), scene.problem.observations.size());
  EXPECT_TRUE(
      std::is_sorted(observations.begin(), observations.end(), [](const auto& a, const auto& b) {
        return std::make_pair(a.camera, a.point) < std::make_pair(b.camera, b.point);
      }));
  ASSERT_FALSE(scene.outliers.empty());
  EXPECT_TRUE(std::is_sorted(sorted.outliers.begin(), sorted.outliers.end()));
  EXPECT_EQ(OutliersOf(sorted), OutliersOf(scene));
}

struct Solved {
  Summary summary;
  std::vector<double> state;
};

Solved SolveBy(PreconditionerKind preconditioner, bool single, int num_threads,
               const BalProblem& problem) {
  FactorGraph graph;
  AddBal(problem, std::make_shared<HuberLoss>(2.0), &graph);
  SolverOptions options;
  options.linear_model = LinearModelKind::kIterativeSchur;
  options.conjugate_gradients.preconditioner = preconditioner;
  options.conjugate_gradients.single_precision_jacobians = single;
  options.max_num_iterations = 5;
  options.num_threads = num_threads;
  Solved solved;
  solved.summary = Solve(options, &graph);
  solved.state = graph.state();
  return solved;
}

// Sums over all factors come in another order: equal to their rounding, and what CG makes of it.
TEST(PhotoOrder, SolvesTakeTheSameStepsInBothOrders) {
  const SimulatedBal scene = Photos();
  SimulatedBal sorted = scene;
  sorted.SortByCamera();
  for (const PreconditionerKind preconditioner :
       {PreconditionerKind::kSchurJacobi, PreconditionerKind::kTwoLevel}) {
    for (const bool single : {false, true}) {
      const Solved by_point = SolveBy(preconditioner, single, 1, scene.problem);
      const Solved by_photo = SolveBy(preconditioner, single, 1, sorted.problem);
      ASSERT_NE(by_point.summary.termination, Termination::kFailure);
      ASSERT_EQ(by_photo.summary.iterations.size(), by_point.summary.iterations.size());
      EXPECT_LT(by_photo.summary.final_cost, 0.5 * by_photo.summary.initial_cost);
      const double cost = by_point.summary.final_cost;
      EXPECT_NEAR(by_photo.summary.final_cost, cost, 1e-9 * cost);
      for (std::size_t k = 0; k < by_point.state.size(); ++k) {
        ASSERT_NEAR(by_photo.state[k], by_point.state[k],
                    1e-6 * (1.0 + std::abs(by_point.state[k])));
      }
      EXPECT_EQ(SolveBy(preconditioner, single, 2, sorted.problem).state, by_photo.state);
    }
  }
}

}  // namespace
}  // namespace inceres
