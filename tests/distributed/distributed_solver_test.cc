// On any number of ranks: the iterations and the result of one process.
#include "inceres/distributed/distributed_solver.h"

#include <cmath>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/io/bal_graph.h"
#include "inceres/problem/losses.h"
#include "inceres/solver/solver.h"
#include "tests/distributed/parts.h"

namespace inceres::test {
namespace {

void ExpectSameIterations(const Summary& together, const Summary& alone, double tolerance) {
  ASSERT_TRUE(together.IsSolutionUsable()) << together.message << " " << together.detail;
  EXPECT_EQ(together.termination, alone.termination);
  ASSERT_EQ(together.iterations.size(), alone.iterations.size());
  for (std::size_t k = 0; k < alone.iterations.size(); ++k) {
    const IterationSummary& a = together.iterations[k];
    const IterationSummary& b = alone.iterations[k];
    // on the way along the gauge, which steps determine less well than the cost
    EXPECT_NEAR(a.cost, b.cost, 1e4 * tolerance * b.cost) << "iteration " << k;
    EXPECT_EQ(a.step_is_successful, b.step_is_successful) << "iteration " << k;
    EXPECT_NEAR(a.gradient_max_norm, b.gradient_max_norm, 1e-3 * b.gradient_max_norm + 1e-6);
  }
  EXPECT_NEAR(together.final_cost, alone.final_cost, tolerance * alone.final_cost);
}

struct Case {
  const char* name;
  TrustRegionStrategyKind strategy;
  DistributedLinearSolver linear_solver;
  bool huber;
};

class SameAsAlone : public testing::TestWithParam<Case> {};

TEST_P(SameAsAlone, StreetOf16Cameras) {
  const BalProblem& bal = Street();
  const auto loss = GetParam().huber ? std::make_shared<HuberLoss>(1.0) : nullptr;
  DistributedOptions options;
  options.solver = ExactOptions();
  options.solver.strategy = GetParam().strategy;
  options.linear_solver = GetParam().linear_solver;
  BalPart own(bal, loss);
  const bool anchored = GetParam().strategy == TrustRegionStrategyKind::kDogleg;
  if (anchored) {  // steps without damping are determined by nothing else along the gauge
    own.Anchor(bal, /*constant_camera=*/2);
  }
  DistributedSolver solver(MPI_COMM_WORLD, options);
  const DistributedSummary together = solver.Solve(own.part());

  SolverOptions direct;
  direct.strategy = GetParam().strategy;
  FactorGraph graph;
  const BalGraph ids = AddBal(bal, loss, &graph);
  if (anchored) {
    AnchorCameras(bal, /*constant_camera=*/2, ids.cameras, &graph);
  }
  const Summary alone = Solve(direct, &graph);
  ExpectSameIterations(together.solve, alone, 1e-10);
  ASSERT_EQ(together.ranks.size(), static_cast<std::size_t>(NumRanks()));
  EXPECT_EQ(together.solve.sizes.num_factors, alone.sizes.num_factors);
  EXPECT_EQ(together.solve.sizes.num_dimensions, alone.sizes.num_dimensions);
  EXPECT_EQ(together.solve.work.num_landmarks, alone.work.num_landmarks);

  // All ranks have the same cameras, to the bit.
  std::vector<double> lowest(static_cast<std::size_t>(bal.num_cameras), HUGE_VAL);
  std::vector<double> highest(lowest.size(), -HUGE_VAL);
  for (std::size_t i = 0; i < lowest.size(); ++i) {
    if (own.cameras()[i] >= 0) {
      lowest[i] = highest[i] = own.graph().Values(own.cameras()[i])[0];
      EXPECT_EQ(lowest[i] == bal.CameraData(static_cast<int>(i))[0], anchored && i == 2);
    }
  }
  MPI_Allreduce(MPI_IN_PLACE, lowest.data(), bal.num_cameras, MPI_DOUBLE, MPI_MIN, MPI_COMM_WORLD);
  MPI_Allreduce(MPI_IN_PLACE, highest.data(), bal.num_cameras, MPI_DOUBLE, MPI_MAX, MPI_COMM_WORLD);
  EXPECT_EQ(lowest, highest);
}

INSTANTIATE_TEST_SUITE_P(
    Ways, SameAsAlone,
    testing::Values(Case{"Gradients", TrustRegionStrategyKind::kLevenbergMarquardt,
                         DistributedLinearSolver::kConjugateGradients, false},
                    Case{"GradientsHuber", TrustRegionStrategyKind::kLevenbergMarquardt,
                         DistributedLinearSolver::kConjugateGradients, true},
                    Case{"Cholesky", TrustRegionStrategyKind::kLevenbergMarquardt,
                         DistributedLinearSolver::kCholesky, false},
                    Case{"Ksp", TrustRegionStrategyKind::kLevenbergMarquardt,
                         DistributedLinearSolver::kKsp, true},
                    Case{"Dogleg", TrustRegionStrategyKind::kDogleg,
                         DistributedLinearSolver::kCholesky, false},
                    Case{"DoglegHuber", TrustRegionStrategyKind::kDogleg,
                         DistributedLinearSolver::kCholesky, true}),
    [](const auto& way) { return std::string(way.param.name); });

}  // namespace
}  // namespace inceres::test
