// docs/ceres_contract.md, "Minimizer and line search options". Test names are the fields'.
#include <cmath>

#include "conformance/support.h"

namespace conformance {
namespace {

TEST(Options21, minimizer_type) {
  for (const auto type : {ceres::TRUST_REGION, ceres::LINE_SEARCH}) {
    Line line;
    Options options = Small();
    options.minimizer_type = type;
    const Solver solver = type == ceres::TRUST_REGION ? Solver::kOurs : Solver::kAnyone;
    const Summary summary = Solve(options, &line.problem, solver).summary;
    EXPECT_EQ(summary.minimizer_type, type);
    EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE);
    EXPECT_NEAR(line.x[0], 10.0, 1e-6);
  }
}

TEST(Options21, line_search_direction_type) {
  const auto change = [](Options* o) { o->line_search_direction_type = ceres::STEEPEST_DESCENT; };
  EXPECT_EQ(ExpectNoEffect(Small(), change).line_search_direction_type, ceres::STEEPEST_DESCENT);
  EXPECT_EQ(ExpectNoEffect(Small(), [](Options*) {}).line_search_direction_type, ceres::LBFGS);
}

// Validated whatever the minimizer: (L)BFGS requires WOLFE.
TEST(Options21, line_search_type) {
  const auto change = [](Options* o) {
    o->line_search_direction_type = ceres::STEEPEST_DESCENT;
    o->line_search_type = ceres::ARMIJO;
  };
  EXPECT_EQ(ExpectNoEffect(Small(), change).line_search_type, ceres::ARMIJO);
  Line line;
  Options options = Small();
  options.line_search_type = ceres::ARMIJO;
  const Outcome outcome = Solve(options, &line.problem);
  EXPECT_EQ(outcome.summary.termination_type, ceres::FAILURE);
  EXPECT_EQ(line.x[0], 0.5);
}

TEST(Options21, nonlinear_conjugate_gradient_type) {
  const auto change = [](Options* o) {
    o->nonlinear_conjugate_gradient_type = ceres::HESTENES_STIEFEL;
  };
  EXPECT_EQ(ExpectNoEffect(Small(), change).nonlinear_conjugate_gradient_type,
            ceres::HESTENES_STIEFEL);
}

TEST(Options21, max_lbfgs_rank) {
  EXPECT_EQ(ExpectNoEffect(Small(), [](Options* o) { o->max_lbfgs_rank = 7; }).max_lbfgs_rank, 7);
}

TEST(Options21, use_approximate_eigenvalue_bfgs_scaling) {
  ExpectNoEffect(Small(), [](Options* o) { o->use_approximate_eigenvalue_bfgs_scaling = true; });
}

TEST(Options21, max_num_line_search_direction_restarts) {
  ExpectNoEffect(Small(), [](Options* o) { o->max_num_line_search_direction_restarts = 1; });
}

TEST(Options21, line_search_sufficient_curvature_decrease) {
  ExpectNoEffect(Small(), [](Options* o) { o->line_search_sufficient_curvature_decrease = 0.5; });
}

TEST(Options21, max_line_search_step_expansion) {
  ExpectNoEffect(Small(), [](Options* o) { o->max_line_search_step_expansion = 2.0; });
}

// r = atan(x) from x = 2 with a bound that never binds. The full step goes to about −3.535 and
// raises the cost from 0.613 to 0.838, so the projected search has to shorten it.
struct Overshoot : World {
  Overshoot() : x(Add({2.0})) {
    auto* cost =
        new Cost(1, {1}, [this](double const* const* p, double* residuals, double** jacobians) {
          trials.push_back((p[0][0] - 2.0) / kFullStep);
          residuals[0] = std::atan(p[0][0]);
          if (jacobians != nullptr && jacobians[0] != nullptr) {
            jacobians[0][0] = 1.0 / (1.0 + p[0][0] * p[0][0]);
            ++num_jacobians;
          }
          return true;
        });
    problem.AddResidualBlock(cost, nullptr, x);
    problem.SetParameterLowerBound(x, 0, -100.0);
  }
  // atan(2)·5/(1 + 1e-4): the Gauss–Newton step with the first damping.
  static constexpr double kFullStep = -5.0 * 1.1071487177940904 / 1.0001;
  std::vector<double> trials;  // fractions of the full step, in the order of evaluation
  int num_jacobians = 0;
  double* x;
};

// One step. Evaluations: start, t = 1, the search's trials, the candidate, and again with Jacobian
// if it is accepted.
Summary OneStep(Overshoot* world, const std::function<void(Options*)>& change = nullptr) {
  Options options = Small();
  options.max_num_iterations = 1;
  options.line_search_interpolation_type = ceres::BISECTION;
  if (change) {
    change(&options);
  }
  return Solve(options, &world->problem).summary;
}

void ExpectTrials(const Overshoot& world, const std::vector<double>& fractions) {
  ASSERT_EQ(world.trials.size(), fractions.size());
  for (std::size_t i = 0; i < fractions.size(); ++i) {
    EXPECT_NEAR(world.trials[i], fractions[i], 1e-6) << "evaluation " << i;
  }
}

TEST(Options21, line_search_interpolation_type) {
  Overshoot bisection;
  const Summary summary = OneStep(&bisection);
  EXPECT_EQ(summary.line_search_interpolation_type, ceres::BISECTION);
  ExpectTrials(bisection, {0.0, 1.0, 0.5, 0.5, 0.5});
  Overshoot quadratic;
  OneStep(&quadratic, [](Options* o) { o->line_search_interpolation_type = ceres::QUADRATIC; });
  EXPECT_EQ(quadratic.num_jacobians, 2);
  Overshoot cubic;
  const Summary with_gradients =
      OneStep(&cubic, [](Options* o) { o->line_search_interpolation_type = ceres::CUBIC; });
  EXPECT_EQ(with_gradients.line_search_interpolation_type, ceres::CUBIC);
  EXPECT_EQ(cubic.num_jacobians, 4) << "every trial of the cubic search wants the gradient";
  EXPECT_NE(cubic.trials[2], quadratic.trials[2]);
}

TEST(Options21, min_line_search_step_size) {
  Overshoot world;
  OneStep(&world,
          [](Options* o) { o->min_line_search_step_size = 3.0; });  // half the full step is 2.77
  ExpectTrials(world, {0.0, 1.0, 1.0});
  EXPECT_EQ(world.x[0], 2.0) << "the search gives up and the full step is rejected";
}

TEST(Options21, line_search_sufficient_function_decrease) {
  // half the step lowers the cost by 0.410; with c₁ = 0.7 it would take 0.7 · 0.613
  Overshoot world;
  OneStep(&world, [](Options* o) { o->line_search_sufficient_function_decrease = 0.7; });
  ExpectTrials(world, {0.0, 1.0, 0.5, 0.25, 0.25, 0.25});
}

TEST(Options21, max_line_search_step_contraction) {
  Overshoot world;
  OneStep(&world, [](Options* o) { o->max_line_search_step_contraction = 0.55; });
  ExpectTrials(world, {0.0, 1.0, 0.55, 0.55, 0.55});
}

TEST(Options21, min_line_search_step_contraction) {
  Overshoot world;
  OneStep(&world, [](Options* o) { o->min_line_search_step_contraction = 0.4; });
  ExpectTrials(world, {0.0, 1.0, 0.4, 0.4, 0.4});
}

TEST(Options21, max_num_line_search_step_size_iterations) {
  Overshoot off;
  const Summary summary =
      OneStep(&off, [](Options* o) { o->max_num_line_search_step_size_iterations = 0; });
  ExpectTrials(off, {0.0, 1.0});
  EXPECT_EQ(summary.num_line_search_steps, 0);
  Overshoot one;
  OneStep(&one, [](Options* o) { o->max_num_line_search_step_size_iterations = 1; });
  ExpectTrials(one, {0.0, 1.0, 1.0});
}

}  // namespace
}  // namespace conformance
