// The two-level preconditioner on any number of ranks: aggregates, iterations and result of one
// process.
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "distributed/ranked_aggregates.h"
#include "inceres/distributed/distributed_solver.h"
#include "inceres/io/bal_graph.h"
#include "inceres/solver/solver.h"
#include "support/core_pipeline.h"
#include "tests/distributed/parts.h"
#include "tools/sim/city_scene.h"

namespace inceres::test {
namespace {

constexpr std::int64_t kWholeY = std::int64_t{1} << 40;

const BalProblem& City() {
  static const BalProblem& kCity = *[] {
    CityOptions options;
    EXPECT_TRUE(GetCityPreset("city-300", &options).ok());
    auto* scene = new SimulatedBal;
    const Status status = GenerateCity(options, nullptr, scene);
    EXPECT_TRUE(status.ok()) << status.message;
    return &scene->problem;
  }();
  return kCity;
}

SolverOptions OptionsFor(PreconditionerKind kind, double eta) {
  SolverOptions options;
  options.conjugate_gradients.preconditioner = kind;
  options.conjugate_gradients.eta = eta;
  options.conjugate_gradients.max_iterations = 5000;
  return options;
}

Summary SolveAlone(SolverOptions options) {
  options.linear_model = LinearModelKind::kIterativeSchur;
  FactorGraph graph;
  AddBal(City(), nullptr, &graph);
  return Solve(options, &graph);
}

DistributedSummary SolveTogether(const SolverOptions& solver, DistributedLinearSolver kind,
                                 BalPart* part) {
  DistributedOptions options;
  options.solver = solver;
  options.linear_solver = kind;
  return DistributedSolver(MPI_COMM_WORLD, options).Solve(part->part());
}

TEST(TwoLevel, AggregatesAreThoseOfOneProcess) {
  FactorGraph whole;
  AddBal(City(), nullptr, &whole);
  const CorePipeline alone(whole, true, 1, kWholeY);
  const internal::LandmarkIncidences of_all(alone.evaluator, kWholeY, /*may_have_tail=*/false);
  const internal::FrameAggregates expected(alone.evaluator, of_all, /*forms_S=*/false);

  const BalPart part(City());
  const internal::Communicator ranks(MPI_COMM_WORLD);
  const internal::Layout layout(*part.part().graph, /*eliminate_landmarks=*/true);
  internal::SharedFrames frames;
  ASSERT_TRUE(frames.Agree(ranks, part.part(), layout).ok());
  const internal::Executor executor(1);
  internal::Evaluator evaluator(*part.part().graph, layout, executor);
  const internal::LandmarkIncidences here(evaluator, kWholeY, /*may_have_tail=*/false);
  const internal::FrameAggregates all =
      internal::RankedAggregates(ranks, frames, evaluator, here).all;
  EXPECT_EQ(all.clusters.cluster_of, expected.clusters.cluster_of);
  EXPECT_EQ(all.is_shared, expected.is_shared);
  EXPECT_EQ(all.count, expected.count);
  EXPECT_GT(all.count, 20);
}

TEST(TwoLevel, ExactStepsAreThoseOfOneProcess) {
  SolverOptions options = OptionsFor(PreconditionerKind::kTwoLevel, 1e-12);
  options.max_num_iterations = 4;
  const Summary alone = SolveAlone(options);
  ASSERT_TRUE(alone.IsSolutionUsable()) << alone.message;
  const auto idle = NumRanks() > 2 ? 1 : -1;
  for (const auto kind :
       {DistributedLinearSolver::kConjugateGradients, DistributedLinearSolver::kKsp}) {
    BalPart part(City(), nullptr, idle);
    SolverOptions own = options;
    own.conjugate_gradients.eta = kind == DistributedLinearSolver::kKsp ? 1e-10 : 1e-12;
    const DistributedSummary together = SolveTogether(own, kind, &part);
    ASSERT_TRUE(together.solve.IsSolutionUsable()) << together.solve.message;
    EXPECT_EQ(together.solve.iterations.size(), alone.iterations.size());
    // on the way along the gauge, which steps determine less well than the cost at the end
    EXPECT_NEAR(together.solve.final_cost / alone.final_cost, 1.0, 1e-7);
  }
}

// kAutomatic stands for conjugate gradients here, and Dog-Leg takes exact steps.
TEST(TwoLevel, DoglegIsRefusedWhereTheAutomaticChoiceIsInexact) {
  SolverOptions options = OptionsFor(PreconditionerKind::kSchurJacobi, 0.01);
  options.strategy = TrustRegionStrategyKind::kDogleg;
  BalPart part(City());
  const Summary refused = SolveTogether(options, DistributedLinearSolver::kAutomatic, &part).solve;
  EXPECT_EQ(refused.termination, Termination::kFailure);
  EXPECT_NE(refused.message.find("kDogleg"), std::string::npos) << refused.message;
}

TEST(TwoLevel, TakesAsManyIterationsAsOneProcessAndFarFewerThanBlocks) {
  const SolverOptions options = OptionsFor(PreconditionerKind::kTwoLevel, 0.01);
  const Summary alone = SolveAlone(options);
  BalPart part(City());
  const DistributedSummary together =
      SolveTogether(options, DistributedLinearSolver::kConjugateGradients, &part);
  ASSERT_TRUE(together.solve.IsSolutionUsable()) << together.solve.message;
  EXPECT_EQ(together.solve.iterations.size(), alone.iterations.size());
  EXPECT_NEAR(together.solve.final_cost / alone.final_cost, 1.0, 1e-4);
  EXPECT_NE(together.solve.reduced_solver.find("two-level"), std::string::npos);

  BalPart again(City());
  const DistributedSummary blocks =
      SolveTogether(OptionsFor(PreconditionerKind::kSchurJacobi, 0.01),
                    DistributedLinearSolver::kConjugateGradients, &again);
  const auto count = static_cast<double>(together.solve.work.num_conjugate_gradients);
  EXPECT_LT(count, 1.2 * static_cast<double>(alone.work.num_conjugate_gradients));
  EXPECT_LT(6.0 * count, static_cast<double>(blocks.solve.work.num_conjugate_gradients));
}

}  // namespace
}  // namespace inceres::test
