// Steps by conjugate gradients: solved to the end they are those of the factorizations, with any
// preconditioner, with S formed or not, with landmarks and without.
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/solver/solver.h"
#include "support/random_graph.h"
#include "support/test_families.h"
#include "trust_region/loop_options.h"

namespace inceres {
namespace {

using test::BundleOptions;
using test::MakeBundle;

BundleOptions Mixed(int landmark_size) {
  BundleOptions bundle;
  bundle.num_frames = 10;
  bundle.num_landmarks = 40;
  bundle.num_views = 5;
  bundle.landmark_sizes = {landmark_size};
  bundle.residual_sizes = {2, 3};
  bundle.losses = bundle.constants = bundle.hosted = true;
  bundle.perturbation = 0.1;
  return bundle;
}

SolverOptions ToTheEnd(LinearModelKind model, PreconditionerKind preconditioner, bool formed) {
  SolverOptions options;
  options.linear_model = model;
  options.max_num_iterations = 5;
  options.conjugate_gradients.preconditioner = preconditioner;
  options.conjugate_gradients.explicit_schur_complement = formed;
  options.conjugate_gradients.eta = 1e-14;
  options.conjugate_gradients.max_iterations = 2000;
  return options;
}

class IterativeModelTest : public ::testing::TestWithParam<int> {};  // landmark size

TEST_P(IterativeModelTest, SolvedToTheEndItsStepsAreTheFactorizations) {
  const auto direct = MakeBundle(Mixed(GetParam()));
  SolverOptions factored;
  factored.linear_model = LinearModelKind::kSchur;
  factored.max_num_iterations = 5;
  const Summary expected = Solve(factored, &direct->graph());
  ASSERT_GE(expected.iterations.size(), 4U);
  struct Way {
    LinearModelKind model;
    PreconditionerKind preconditioner;
    bool formed;
  };
  for (const Way& way :
       {Way{LinearModelKind::kIterativeSchur, PreconditionerKind::kJacobi, false},
        Way{LinearModelKind::kIterativeSchur, PreconditionerKind::kSchurJacobi, false},
        Way{LinearModelKind::kIterativeSchur, PreconditionerKind::kSchurJacobi, true},
        Way{LinearModelKind::kIterativeSchur, PreconditionerKind::kTwoLevel, false},
        Way{LinearModelKind::kIterativeSchur, PreconditionerKind::kTwoLevel, true},
        Way{LinearModelKind::kIterativeSchur, PreconditionerKind::kClusterJacobi, false},
        Way{LinearModelKind::kIterativeSchur, PreconditionerKind::kClusterTridiagonal, false},
        Way{LinearModelKind::kIterativePlain, PreconditionerKind::kJacobi, false}}) {
    const auto bundle = MakeBundle(Mixed(GetParam()));
    const Summary summary =
        Solve(ToTheEnd(way.model, way.preconditioner, way.formed), &bundle->graph());
    ASSERT_EQ(summary.iterations.size(), expected.iterations.size()) << summary.message;
    for (std::size_t k = 0; k < expected.iterations.size(); ++k) {
      EXPECT_NEAR(summary.iterations[k].cost, expected.iterations[k].cost,
                  1e-7 * expected.iterations[k].cost)
          << k << ' ' << summary.reduced_solver;
    }
    EXPECT_GT(summary.work.num_conjugate_gradients, summary.work.num_linear_solves);
    EXPECT_EQ(summary.work.num_steps_without_landmarks, 0);
  }
}

TEST_P(IterativeModelTest, StepsThatTakeTooLongAreUsedAndTold) {
  const auto bundle = MakeBundle(Mixed(GetParam()));
  SolverOptions options =
      ToTheEnd(LinearModelKind::kIterativeSchur, PreconditionerKind::kSchurJacobi, true);
  options.conjugate_gradients.max_iterations = 1;
  const Summary formed = Solve(options, &bundle->graph());
  EXPECT_EQ(formed.work.num_steps_without_landmarks, formed.work.num_linear_solves);
  EXPECT_LT(formed.final_cost, formed.initial_cost);
  options.conjugate_gradients.explicit_schur_complement = false;
  const Summary by_products = Solve(options, &MakeBundle(Mixed(GetParam()))->graph());
  EXPECT_EQ(by_products.work.num_steps_without_landmarks, 0);
  EXPECT_LT(by_products.final_cost, by_products.initial_cost);
}

TEST_P(IterativeModelTest, ToleranceThatFollowsTheGradientTightens) {
  Summary by[2];
  for (const bool follows : {false, true}) {
    SolverOptions options =
        ToTheEnd(LinearModelKind::kIterativeSchur, PreconditionerKind::kSchurJacobi, false);
    options.conjugate_gradients.eta = 0.5;
    options.conjugate_gradients.eta_follows_gradient = follows;
    by[follows ? 1 : 0] = Solve(options, &MakeBundle(Mixed(GetParam()))->graph());
  }
  ASSERT_EQ(by[0].iterations.size(), by[1].iterations.size());
  EXPECT_EQ(by[0].iterations[1].linear_solver_iterations,
            by[1].iterations[1].linear_solver_iterations);
  EXPECT_NEAR(by[1].final_cost, by[0].final_cost, 1e-3 * by[0].final_cost);
  EXPECT_GT(by[1].iterations.back().linear_solver_iterations,
            by[0].iterations.back().linear_solver_iterations);
}

// The tolerance of a solve begins with the options', also where the gradient begins far below that
// which a solve before has ended with.
TEST_P(IterativeModelTest, ToleranceThatFollowsTheGradientIsForgottenBetweenSolves) {
  SolverOptions options =
      ToTheEnd(LinearModelKind::kIterativeSchur, PreconditionerKind::kSchurJacobi, false);
  options.conjugate_gradients.eta = 0.5;
  options.conjugate_gradients.eta_follows_gradient = true;
  SolverOptions short_options = options;
  short_options.max_num_iterations = 1;
  Solver reused;
  reused.Solve(short_options, &MakeBundle(Mixed(GetParam()))->graph());
  Solver fresh;
  Summary by[2];
  for (Solver* solver : {&reused, &fresh}) {
    const auto bundle = MakeBundle(Mixed(GetParam()));
    Solve(SolverOptions(), &bundle->graph());  // to near its minimum
    by[solver == &fresh ? 1 : 0] = solver->Solve(options, &bundle->graph());
  }
  EXPECT_TRUE(by[0].structure_reused);
  EXPECT_FALSE(by[1].structure_reused);
  ASSERT_EQ(by[0].iterations.size(), by[1].iterations.size());
  for (std::size_t k = 0; k < by[0].iterations.size(); ++k) {
    EXPECT_EQ(by[0].iterations[k].cost, by[1].iterations[k].cost) << k;
    EXPECT_EQ(by[0].iterations[k].linear_solver_iterations,
              by[1].iterations[k].linear_solver_iterations)
        << k;
  }
  EXPECT_EQ(by[0].work.num_conjugate_gradients, by[1].work.num_conjugate_gradients);
}

INSTANTIATE_TEST_SUITE_P(LandmarkSizes, IterativeModelTest, ::testing::Values(1, 2, 3, 4));

TEST(IterativeModel, ByASubsetOfAllFactorsTakesOneIteration) {
  for (const bool all : {true, false}) {
    const auto bundle = MakeBundle(Mixed(3));
    auto subset = std::make_shared<std::vector<FactorId>>();
    for (FamilyId family = 0; family < bundle->graph().num_families(); ++family) {
      for (int i = 0; i < bundle->graph().NumFactors(family); i += all ? 1 : 2) {
        subset->push_back({family, i});
      }
    }
    SolverOptions options =
        ToTheEnd(LinearModelKind::kIterativePlain, PreconditionerKind::kSubset, false);
    options.conjugate_gradients.subset = subset;
    options.conjugate_gradients.eta = 0.1;
    std::vector<std::vector<double>> states;
    for (const int num_threads : {1, 2}) {
      const auto copy = MakeBundle(Mixed(3));
      options.num_threads = num_threads;
      const Summary summary = Solve(options, &copy->graph());
      ASSERT_TRUE(summary.IsSolutionUsable()) << summary.message;
      // the second one shows that there is nothing left to gain
      const std::int64_t per_step =
          summary.work.num_conjugate_gradients / summary.work.num_linear_solves;
      EXPECT_EQ(per_step <= 2, all) << per_step;
      states.push_back(copy->graph().state());
    }
    EXPECT_EQ(states[0], states[1]);
    subset->push_back({0, 1 << 20});
    EXPECT_NE(Solve(options, &bundle->graph()).message.find("subset"), std::string::npos);
  }
}

// Residuals 2 (x − 1) + c y and 2 y of an x that is eliminated and a y that is kept. Without c the
// system is 4 I.
Summary SolveWithEliminated(const SolverOptions& options, double coupling) {
  FactorGraph graph;
  const auto family =
      graph.AddFamily(test::JetFamily<2, 1, 1>([coupling](const auto* x, const auto* y, auto* f) {
        f[0] = 2.0 * (x[0] - 1.0) + coupling * y[0];
        f[1] = 2.0 * y[0];
      }));
  const double start = 3.0;
  const VariableId x = graph.AddVariable(&start, 1, Role::kFrame);
  const VariableId y = graph.AddVariable(&start, 1, Role::kFrame);
  graph.AddFactor(family, 0, {x, y});
  const std::vector<VariableId> eliminated = {x};
  internal::LoopOptions loop;
  loop.eliminated = &eliminated;
  Solver solver;
  Summary summary;
  internal::SolveWith(options, loop, &graph, &solver, &summary);
  return summary;
}

TEST(LargeBlockSchurModel, ItsIterationsAreCounted) {
  SolverOptions options =
      ToTheEnd(LinearModelKind::kIterativeSchur, PreconditionerKind::kIdentity, false);
  options.conjugate_gradients.eta = 2.0;
  const Summary summary = SolveWithEliminated(options, 0.5);
  ASSERT_TRUE(summary.IsSolutionUsable()) << summary.message;
  EXPECT_NE(summary.reduced_solver.find("large blocks"), std::string::npos);
  std::int64_t count = 0;
  for (const IterationSummary& iteration : summary.iterations) {
    count += iteration.linear_solver_iterations;
  }
  EXPECT_GT(count, 0);
  EXPECT_GE(summary.work.num_conjugate_gradients, count) << "the last step may have no row";
}

// The first iteration solves the system to the last bit, which Ceres takes for a breakdown where
// its own test is not met: there is no step, and so none that has left landmarks out.
TEST(LargeBlockSchurModel, ABreakdownLeavesNothingOut) {
  SolverOptions options =
      ToTheEnd(LinearModelKind::kIterativeSchur, PreconditionerKind::kSchurJacobi, true);
  options.conjugate_gradients.eta = 0.1;
  options.initial_trust_region_radius = options.max_trust_region_radius = 1e300;
  const Summary summary = SolveWithEliminated(options, 0.0);
  EXPECT_EQ(summary.termination, Termination::kFailure) << summary.message;
  EXPECT_GT(summary.work.num_conjugate_gradients, 0);
  EXPECT_EQ(summary.work.num_steps_without_landmarks, 0);
}

TEST(IterativeModelOptions, TellWhatDoesNotGoTogether) {
  SolverOptions options;
  options.linear_model = LinearModelKind::kIterativeSchur;
  options.strategy = TrustRegionStrategyKind::kDogleg;
  EXPECT_NE(options.Validate().message.find("strategy"), std::string::npos);
  options.strategy = TrustRegionStrategyKind::kLevenbergMarquardt;
  EXPECT_TRUE(options.Validate().ok());
  options.conjugate_gradients.explicit_schur_complement = true;
  EXPECT_NE(options.Validate().message.find("explicit_schur_complement"), std::string::npos);
  options.conjugate_gradients.preconditioner = PreconditionerKind::kTwoLevel;
  EXPECT_TRUE(options.Validate().ok());
  options.conjugate_gradients.explicit_schur_complement = false;
  options.linear_model = LinearModelKind::kIterativePlain;
  EXPECT_NE(options.Validate().message.find("conjugate_gradients.preconditioner"),
            std::string::npos);
  options.conjugate_gradients.preconditioner = PreconditionerKind::kSubset;
  EXPECT_NE(options.Validate().message.find("with a subset"), std::string::npos);
  options.conjugate_gradients.preconditioner = PreconditionerKind::kJacobi;
  options.linear_model = LinearModelKind::kAutomatic;
  options.reduced_solver = ReducedSolverKind::kAutomaticInexact;
  options.conjugate_gradients.eta = -1.0;
  EXPECT_NE(options.Validate().message.find("eta"), std::string::npos);
  options.conjugate_gradients.eta = 0.1;
  options.reduced_solver = ReducedSolverKind::kAutomatic;
  options.linear_model = LinearModelKind::kIterativeSchur;
  options.conjugate_gradients.max_iterations = 0;
  EXPECT_NE(options.Validate().message.find("max_iterations"), std::string::npos);
  options.conjugate_gradients.max_iterations = 500;
  options.conjugate_gradients.eta = std::nan("");
  EXPECT_NE(options.Validate().message.find("eta"), std::string::npos);
}

}  // namespace
}  // namespace inceres
