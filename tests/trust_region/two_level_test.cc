// Conjugate gradients with the two-level preconditioner: on streets of cameras whose factors say
// nothing of what their parameters mean.
#include <algorithm>
#include <string>

#include <gtest/gtest.h>

#include "inceres/solver/solver.h"
#include "support/street_graph.h"

namespace inceres {
namespace {

using test::MakeStreetGraph;
using test::StreetGraphOptions;

SolverOptions With(PreconditionerKind preconditioner, bool formed = false) {
  SolverOptions options;
  options.linear_model = LinearModelKind::kIterativeSchur;
  options.max_num_iterations = 8;
  options.initial_trust_region_radius = 1e8;
  options.function_tolerance = 0.0;
  options.conjugate_gradients.preconditioner = preconditioner;
  options.conjugate_gradients.explicit_schur_complement = formed;
  options.conjugate_gradients.eta = 1e-3;
  options.conjugate_gradients.max_iterations = 20000;
  return options;
}

int MostIterations(const Summary& summary) {
  int most = 0;
  for (const IterationSummary& iteration : summary.iterations) {
    most = std::max(most, iteration.linear_solver_iterations);
  }
  return most;
}

StreetGraphOptions Street(int num_cameras) {
  StreetGraphOptions options;
  options.num_cameras = num_cameras;
  options.drift = 0.002;
  return options;
}

TEST(TwoLevel, TakesFarFewerIterationsAndGrowsFarSlower) {
  const auto most_of = [](PreconditionerKind kind, int num_cameras) {
    StreetGraphOptions street = Street(num_cameras);
    street.drift = 0.001;
    return MostIterations(Solve(With(kind), &MakeStreetGraph(street)->graph));
  };
  const int short_blocks = most_of(PreconditionerKind::kSchurJacobi, 60);
  const int long_blocks = most_of(PreconditionerKind::kSchurJacobi, 240);
  const int short_two = most_of(PreconditionerKind::kTwoLevel, 60);
  const int long_two = most_of(PreconditionerKind::kTwoLevel, 240);
  const int longest_two = most_of(PreconditionerKind::kTwoLevel, 960);
  EXPECT_GT(long_blocks, 4 * short_blocks);  // four times the length
  EXPECT_LT(long_two, 3 * short_two);
  EXPECT_LT(longest_two, long_two * 5 / 2);
  EXPECT_LT(10 * long_two, long_blocks) << short_blocks;
  EXPECT_LT(10 * longest_two, long_blocks) << short_blocks;
}

class TwoLevelOnStreets : public ::testing::TestWithParam<StreetGraphOptions> {};

TEST_P(TwoLevelOnStreets, FindsWhatAFactorizationFindsInFewIterations) {
  const auto direct = MakeStreetGraph(GetParam());
  SolverOptions factored = With(PreconditionerKind::kTwoLevel);
  factored.linear_model = LinearModelKind::kSchur;
  factored.initial_trust_region_radius = 1e4;
  const Summary expected = Solve(factored, &direct->graph);
  for (const bool formed : {false, true}) {
    const auto street = MakeStreetGraph(GetParam());
    SolverOptions options = With(PreconditionerKind::kTwoLevel, formed);
    options.initial_trust_region_radius = 1e4;
    options.conjugate_gradients.eta = 1e-9;
    const Summary summary = Solve(options, &street->graph);
    EXPECT_NEAR(summary.final_cost, expected.final_cost, 1e-6 * expected.final_cost)
        << summary.message;
    EXPECT_LT(MostIterations(summary), 300);
    EXPECT_NE(summary.reduced_solver.find("two-level"), std::string::npos)
        << summary.reduced_solver;
  }
}

StreetGraphOptions Kind(bool split, bool shared_focal, bool inverse_depth, bool held_and_priors) {
  StreetGraphOptions options = Street(100);
  options.split = split;
  options.shared_focal = shared_focal;
  options.inverse_depth = inverse_depth;
  options.first_constant = options.priors = held_and_priors;
  return options;
}

INSTANTIATE_TEST_SUITE_P(Kinds, TwoLevelOnStreets,
                         ::testing::Values(Kind(false, false, false, false),
                                           Kind(true, false, false, true),
                                           Kind(true, true, false, true),
                                           Kind(true, true, false, false),
                                           Kind(false, false, true, true)));

}  // namespace
}  // namespace inceres
