// What a one-time solve may call convergence, and how it goes on where a point that it has accepted
// has no Jacobians.

#include <cmath>
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "incremental/one_time_solve.h"
#include "support/classic_problems.h"
#include "support/test_families.h"

namespace inceres {
namespace {

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

}  // namespace
}  // namespace inceres
