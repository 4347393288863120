// What a one-time solve may call convergence, and how it goes on where a point that it has accepted
// has no Jacobians.

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "incremental/one_time_solve.h"
#include "incremental/stagnation.h"
#include "support/classic_problems.h"
#include "support/test_families.h"

namespace inceres {
namespace {

using internal::Stagnation;
using test::FunctionFamily;

// Of a function of (x, y).
UpdateSummary SolvePlane(const std::shared_ptr<FunctionFamily>& of_xy, double* xy) {
  FactorGraph graph;
  const auto family = graph.AddFamily(of_xy);
  graph.AddFactor(family, 0, {graph.AddVariable(xy, 2, Role::kFrame)});
  Solver solver(/*max_bytes=*/0);
  UpdateSummary summary;
  internal::SolveOnce(IncrementalOptions(), &solver, &graph, &summary);
  xy[0] = graph.state()[0];
  xy[1] = graph.state()[1];
  return summary;
}

// Along x a saddle at 0, and minima at ±√½: the model has a curvature of one there, and the cost of
// minus one. y is at its minimum after a step.
std::shared_ptr<FunctionFamily> Saddle() {
  return test::JetFamily<3, 2>([](const auto* p, auto* f) {
    f[0] = 1.0 - p[0] * p[0];
    f[1] = p[0];
    f[2] = 100.0 * (p[1] - 1.0);
  });
}

// At the claim the model promises less than a tenth of the tolerance; the step gains three times
// that.
TEST(OneTimeClaims, AreTriedByAStepNearASaddle) {
  double xy[2] = {1.5e-4, 1.0 - 9e-5};
  const UpdateSummary summary = SolvePlane(Saddle(), xy);
  EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
  EXPECT_NEAR(xy[0], std::sqrt(0.5), 1e-2);
}

// Half of what is left at the start is noise. Were a gradient small by itself, the lighter one
// would end there.
TEST(OneTimeClaims, DoNotDependOnTheUnitOfTheCost) {
  double expected[2] = {0.0, 0.0};
  for (const double weight : {1.0, 1e-8, 1e8}) {
    const auto fit = test::JetFamily<6, 2>([weight](const auto* p, auto* f) {
      using std::exp;
      const double noise[6] = {0.1, -0.1, 0.05, 0.02, -0.06, 0.01};
      for (int k = 0; k < 6; ++k) {
        const double t = 0.2 * k;
        f[k] = weight * (p[0] * exp(p[1] * t) - exp(0.8 * t) - noise[k]);
      }
    });
    double ab[2] = {0.5, 0.1};
    const UpdateSummary summary = SolvePlane(fit, ab);
    EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
    if (weight == 1.0) {
      std::copy(ab, ab + 2, expected);
      EXPECT_NEAR(ab[1], 0.8, 0.1);
    }
    EXPECT_NEAR(ab[0], expected[0], 1e-6) << weight << summary.message;
    EXPECT_NEAR(ab[1], expected[1], 1e-6) << weight;
  }
}

// Without noise all that is left in the end is rounding, which is not worked on.
TEST(OneTimeClaims, EndWhereTheCostIsRounding) {
  const auto line = test::JetFamily<3, 2>([](const auto* p, auto* f) {
    for (int k = 0; k < 3; ++k) {
      f[k] = p[0] + 0.3 * k * p[1] + 0.1 * p[0] * p[1] - 1.0 - 0.7 * k - 0.1 * 7.0 / 3.0;
    }
  });
  double xy[2] = {0.3, 0.3};
  const UpdateSummary summary = SolvePlane(line, xy);
  EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
  EXPECT_LT(summary.final_cost, 1e-25);
  EXPECT_LT(summary.num_iterations, 10) << summary.FullReport();
}

// Where x and y differ is 1e-10 times as stiff as their sum, and a constant keeps the tolerance
// from falling.
std::shared_ptr<FunctionFamily> WeakDifference() {
  return test::JetFamily<3, 2>([](const auto* p, auto* f) {
    f[0] = 100.0 + p[0] + p[1];
    f[1] = 1e-5 * (p[0] - p[1] - 500.0);
    f[2] = 0.0 * p[0] + 1.0;
  });
}

TEST(OneTimeClaims, DoNotRestOnAStepThatDampingHoldsBack) {
  double xy[2] = {0.0, 0.0};
  const UpdateSummary summary = SolvePlane(WeakDifference(), xy);
  EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
  EXPECT_LT(summary.final_cost, 0.5 * (1.0 + 2e-6));
}

// Rosenbrock's function, and a factor that has a cost everywhere, and once no Jacobian.
TEST(OneTimeClaims, AStepWhoseEndHasNoJacobiansIsTakenBack) {
  FactorGraph graph;
  test::MakeRosenbrock(&graph);
  int num_jacobians = 0;
  const auto family = graph.AddFamily(std::make_shared<FunctionFamily>(
      1, std::vector<FactorFamily::Slot>{{2, 2}},
      [&num_jacobians](int, const double* const*, double* f, double** J) {
        f[0] = 0.0;
        if (J != nullptr) {
          J[0][0] = J[0][1] = 0.0;
        }
        return J == nullptr || num_jacobians++ != 3;
      }));
  graph.AddFactor(family, 0, {0});
  Solver solver(/*max_bytes=*/0);
  UpdateSummary summary;
  internal::SolveOnce(IncrementalOptions(), &solver, &graph, &summary);
  EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
  EXPECT_NE(summary.failed_step.find("factor 0 of function"), std::string::npos)
      << summary.failed_step;
  EXPECT_NEAR(graph.state()[0], 1.0, 1e-3);
  ASSERT_GT(summary.iterations.size(), 4u);
  EXPECT_FALSE(summary.iterations[3].step_is_successful);
  EXPECT_EQ(summary.final_cost, summary.iterations.back().cost);
}

// Two blocks, x, of one value or of two, and y of two. x begins where a factor refuses to go on,
// and would go on; y is far from its minimum, by residuals that are not linear.
template <int kSizeOfX>
struct Border {
  Border() {
    const auto border =
        graph.AddFamily(test::JetFamily<kSizeOfX, kSizeOfX>([](const auto* p, auto* f) {
          for (int k = 0; k < kSizeOfX; ++k) {
            f[k] = p[k] - 3.0;
          }
          // The normal of the border is none of the axes, and not the gradient.
          return p[0] + (kSizeOfX > 1 ? 0.3 : 0.0) * p[kSizeOfX - 1] <= 1.0;
        }));
    const auto both =
        graph.AddFamily(test::JetFamily<3, kSizeOfX, 2>([](const auto* p, const auto* q, auto* f) {
          f[0] = q[0] + 0.1 * q[0] * q[0] - p[0];
          f[1] = q[1] - 2.0 * p[0];
          f[2] = 0.5 * (q[0] + q[1]) - 4.0;
        }));
    const double start[2] = {1.0, 0.0};
    x = graph.AddVariable(start, kSizeOfX, Role::kFrame);
    const double far[2] = {9.0, -5.0};
    y = graph.AddVariable(far, 2, Role::kFrame);
    graph.AddFactor(border, 0, {x});
    graph.AddFactor(both, 0, {x, y});
  }

  UpdateSummary Solve() {
    Solver solver(/*max_bytes=*/0);
    UpdateSummary summary;
    internal::SolveOnce(IncrementalOptions(), &solver, &graph, &summary);
    return summary;
  }

  FactorGraph graph;
  VariableId x = -1;
  VariableId y = -1;
};

// The cost with x where it begins, and y at its minimum.
template <int kSizeOfX>
double LeastAtBorder() {
  Border<kSizeOfX> world;
  GraphEdit edit(world.graph);
  edit.SetConstant(world.x, true);
  EXPECT_TRUE(world.graph.Apply(edit).ok());
  SolverOptions options;
  options.function_tolerance = 1e-14;
  const Summary summary = Solve(options, &world.graph);
  EXPECT_LT(summary.final_cost, 0.9 * summary.initial_cost);
  return summary.final_cost;
}

// x has one direction, and that is refused: with y at its minimum it is a minimum.
TEST(OneTimeClaims, WhoDoesNotRefuseGoesOnWhereABorderStopsTheRest) {
  Border<1> world;
  const UpdateSummary summary = world.Solve();
  EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
  EXPECT_TRUE(summary.rests_on_refusals);
  EXPECT_NE(summary.message.find("refuse"), std::string::npos) << summary.message;
  const double least = LeastAtBorder<1>();
  EXPECT_LE(summary.final_cost, least * (1.0 + 1e-6));
  EXPECT_GE(summary.final_cost, least * (1.0 - 1e-6));
}

// x could still go along the border, where it would gain: nothing that is called a minimum is above
// what it could gain there.
TEST(OneTimeClaims, ABorderThatCanBeFollowedIsNoMinimum) {
  Border<2> world;
  const UpdateSummary summary = world.Solve();
  EXPECT_LE(summary.final_cost, LeastAtBorder<2>() * (1.0 + 1e-6));
  EXPECT_LT(summary.iterations.size(), 51u);
}

// Steps that gain a hundredth of the tolerance each.
Stagnation::Verdict Walk(double radius, double* restart_radius) {
  const internal::Tuning::Batch tuning;
  Stagnation stagnation(tuning);
  double cost = 1.0;
  stagnation.Begin(cost);
  IterationSummary iteration;
  iteration.step_is_successful = true;
  iteration.cost_change = 1e-8;
  iteration.trust_region_radius = radius;
  for (int i = 0; i < 15; ++i) {
    cost -= iteration.cost_change;
    const Stagnation::Verdict verdict = stagnation.After(iteration, cost, 1e-6, radius);
    *restart_radius = std::max(*restart_radius, stagnation.TakeRestartRadius());
    if (verdict != Stagnation::Verdict::kGoOn) {
      return verdict;
    }
  }
  return Stagnation::Verdict::kGoOn;
}

TEST(Stagnation, IsProvenByStepsWithLittleDampingOnly) {
  const double proof_radius = internal::Tuning::Batch().proof_radius;
  for (const double radius : {1e-5, 0.1 * proof_radius, proof_radius, 1e8}) {
    double restart_radius = 0.0;
    EXPECT_EQ(Walk(radius, &restart_radius), radius >= proof_radius
                                                 ? Stagnation::Verdict::kProven
                                                 : Stagnation::Verdict::kUnproven)
        << radius;
    EXPECT_EQ(restart_radius, proof_radius);
  }
}

// All lengths of steps refused, where the gradient promises so many tolerances times the radius;
// the radii to begin anew from go to `restarts`. The number of steps.
int StepsAtBorder(double tolerances, std::vector<double>* restarts) {
  const internal::Tuning::Batch tuning;
  constexpr double kTolerance = 1e-6;
  Stagnation stagnation(tuning);
  stagnation.Begin(1.0);
  IterationSummary refused;
  refused.cost = std::numeric_limits<double>::max();
  double radius = tuning.proof_radius;
  Stagnation::Verdict verdict = Stagnation::Verdict::kGoOn;
  int num_steps = 0;
  for (; num_steps < 50 && verdict == Stagnation::Verdict::kGoOn; ++num_steps) {
    refused.trust_region_radius = 1e-2 * radius;
    refused.model_cost_change = tolerances * kTolerance * radius;
    verdict = stagnation.After(refused, 1.0, kTolerance, radius);
    const double restart = stagnation.TakeRestartRadius();
    radius = restart > 0.0 ? restart : refused.trust_region_radius;
    if (restart > 0.0) {
      restarts->push_back(restart);
    }
  }
  EXPECT_EQ(verdict, Stagnation::Verdict::kRefusals);
  return num_steps;
}

// At a border every second decade of the damping is passed over: those are tried before the end.
TEST(Stagnation, AtABorderEndsAfterTwoLaddersOfDampings) {
  const std::vector<double> once{0.1 * internal::Tuning::Batch().proof_radius};
  std::vector<double> restarts;
  // From 1e4 and from 1e3 down to 1e-8.
  EXPECT_EQ(StepsAtBorder(1e9, &restarts), 13);
  EXPECT_EQ(restarts, once);
  // Until they promise a thousandth of the tolerance: with 1e-4, and with 1e-3.
  restarts.clear();
  EXPECT_EQ(StepsAtBorder(1.0, &restarts), 9);
  EXPECT_EQ(restarts, once);
}

// One step with next to no damping, and lengths from some other one on, are not all of them.
TEST(Stagnation, AtABorderOneStepWithLittleDampingIsNoLadder) {
  const internal::Tuning::Batch tuning;
  constexpr double kTolerance = 1e-6;
  Stagnation stagnation(tuning);
  stagnation.BeginAtBorder(1.0, /*refused=*/true);
  EXPECT_EQ(stagnation.TakeRestartRadius(), tuning.proof_radius);
  IterationSummary refused;
  refused.cost = std::numeric_limits<double>::max();
  refused.model_cost_change = 1.0;
  Stagnation::Verdict verdict = Stagnation::Verdict::kGoOn;
  for (const double radius : {1e8, 1e-4, 1e-6}) {
    refused.trust_region_radius = 1e-2 * radius;
    verdict = stagnation.After(refused, 1.0, kTolerance, radius);
  }
  EXPECT_NE(verdict, Stagnation::Verdict::kRefusals);
}

// Each length of a step gains a little before the border cuts it, and all of them together less
// than the tolerance: that goes on, and proves nothing.
TEST(Stagnation, CreepingAlongABorderEndsWithoutAProof) {
  const internal::Tuning::Batch tuning;
  constexpr double kTolerance = 1e-6;
  Stagnation stagnation(tuning);
  double cost = 1.0;
  stagnation.Begin(cost);
  IterationSummary cut;
  cut.step_is_successful = true;
  cut.step_share = 1e-6;
  cut.cost_change = 0.1 * kTolerance;
  double radius = tuning.proof_radius;
  Stagnation::Verdict verdict = Stagnation::Verdict::kGoOn;
  int num_iterations = 0;
  for (; num_iterations < 100 && verdict == Stagnation::Verdict::kGoOn; ++num_iterations) {
    cost -= cut.cost_change;
    cut.trust_region_radius = 1e-2 * radius;
    verdict = stagnation.After(cut, cost, kTolerance, radius);
    const double restart = stagnation.TakeRestartRadius();
    radius = restart > 0.0 ? restart : cut.trust_region_radius;
  }
  EXPECT_EQ(verdict, Stagnation::Verdict::kUnproven);
  EXPECT_LT(num_iterations, 20);
  EXPECT_NE(stagnation.InWords(verdict, cost).find("creep"), std::string::npos);
}

}  // namespace
}  // namespace inceres
