// docs/ceres_contract.md, "Trust-region options": which steps are taken and when it ends. Test
// names are the fields'.
#include <cmath>
#include <limits>

#include "conformance/support.h"

namespace conformance {
namespace {

TEST(Options22, min_relative_decrease) {
  for (const double threshold : {0.9, 0.95}) {  // the first step's is 15/16 = 0.9375
    Parabola parabola;
    Options options = Small();
    options.min_relative_decrease = threshold;
    options.max_num_iterations = 1;
    const Summary summary = Solve(options, &parabola.problem).summary;
    ASSERT_EQ(summary.iterations.size(), 2u);
    EXPECT_TRUE(summary.iterations[1].step_is_valid);
    EXPECT_EQ(summary.iterations[1].step_is_successful, threshold < 0.9375);
    EXPECT_NEAR(summary.iterations[1].relative_decrease, 0.9375, 1e-4);
    EXPECT_EQ(parabola.x[0] == 1.0, threshold > 0.9375);
  }
}

double FirstStep(const std::function<void(Options*)>& change) {
  Line line;
  Options options = Small();
  options.initial_trust_region_radius = 1.0;
  options.max_num_iterations = 1;
  change(&options);
  Solve(options, &line.problem);
  return line.x[0] - 0.5;
}

// Without scaling the diagonal is 1 and (1 + clamp(1)/radius) δ = 9.5.
TEST(Options22, min_lm_diagonal) {
  const auto change = [](Options* o) {
    o->jacobi_scaling = false;
    o->min_lm_diagonal = 4.0;
  };
  ExpectClose(FirstStep(change), 1.9);
}

TEST(Options22, max_lm_diagonal) {
  const auto change = [](Options* o) {
    o->jacobi_scaling = false;
    o->max_lm_diagonal = 0.25;
  };
  ExpectClose(FirstStep(change), 7.6);
}

// IsValid lets it pass, the strategy's constructor does not.
TEST(Options22, min_lm_diagonal_of_zero_dies) {
  const auto change = [](Options* o) { o->min_lm_diagonal = 0.0; };
  EXPECT_DEATH(FirstStep(change), "min_diagonal");
}

// The clamp acts on the scaled column: its square is 1/4, raised to 1, so Λ = 1/(radius·s²) = 4.
TEST(Options22, jacobi_scaling) {
  const auto change = [](bool scaling) {
    return [=](Options* o) {
      o->jacobi_scaling = scaling;
      o->min_lm_diagonal = 1.0;
    };
  };
  ExpectClose(FirstStep(change(true)), 1.9);
  ExpectClose(FirstStep(change(false)), 4.75);
}

TEST(Options22, max_num_consecutive_invalid_steps) {
  for (const int limit : {5, 2}) {
    NeverValid world;
    Options options = Small();
    options.gradient_tolerance = 0.0;
    options.max_num_consecutive_invalid_steps = limit;
    options.update_state_every_iteration = limit == 2;
    const Summary summary = Solve(options, &world.problem).summary;
    EXPECT_EQ(summary.termination_type, ceres::FAILURE);
    EXPECT_EQ(summary.message,
              "Number of consecutive invalid steps more than "
              "Solver::Options::max_num_consecutive_invalid_steps: " +
                  std::to_string(limit));
    EXPECT_EQ(summary.iterations.size(), static_cast<std::size_t>(limit))
        << "the fatal one is not in the trace";
    EXPECT_EQ(world.x[0], 0.0);
  }
}

TEST(Options22, function_tolerance) {
  for (const double tolerance :
       {0.93, 0.95}) {  // the first step changes the cost by 0.9375 of itself
    Parabola parabola;
    Options options = Small();
    options.function_tolerance = tolerance;
    options.max_num_iterations = 1;
    const Summary summary = Solve(options, &parabola.problem).summary;
    if (tolerance < 0.9375) {
      EXPECT_EQ(summary.termination_type, ceres::NO_CONVERGENCE);
    } else {
      EXPECT_TRUE(
          StartsWith(summary.message, "Function tolerance reached. |cost_change|/cost: 9.37"))
          << summary.message;
      EXPECT_NE(summary.message.find(" <= 9.500000e-01"), std::string::npos);
      EXPECT_EQ(parabola.x[0], 1.0) << "the candidate is discarded";
    }
  }
}

TEST(Options22, gradient_tolerance) {
  Line line;
  Options options = Small();
  options.gradient_tolerance = 1e-3;
  const Summary summary = Solve(options, &line.problem).summary;
  EXPECT_EQ(summary.message,
            "Gradient tolerance reached. Gradient max norm: 9.499050e-04 <= 1.000000e-03");
  EXPECT_EQ(summary.iterations.size(), 2u);
}

// A rejected step is no occasion to test the gradient.
TEST(Options22, gradient_tolerance_at_successful_iterations_only) {
  Line line;
  Options options = Small();
  options.gradient_tolerance = 10.0;
  const Summary summary = Solve(options, &line.problem).summary;
  EXPECT_EQ(summary.message,
            "Gradient tolerance reached. Gradient max norm: 9.500000e+00 <= 1.000000e+01");
  EXPECT_EQ(summary.iterations.size(), 1u);
}

// It cannot fire before a step was accepted: up to Ceres 2.1 because ‖x‖ is −1 until then, from 2.2
// on because it is not asked.
TEST(Options22, parameter_tolerance) {
  Line line(9.99);
  Options options = Small();
  options.parameter_tolerance = 0.5;
  const Summary summary = Solve(options, &line.problem).summary;
  EXPECT_TRUE(StartsWith(summary.message, "Parameter tolerance reached. Relative step_norm: "))
      << summary.message;
  EXPECT_NE(summary.message.find(" <= 5.000000e-01."), std::string::npos) << summary.message;
  EXPECT_EQ(summary.iterations.size(), 2u)
      << "the step that ends it is not in the trace, the one before was taken";
}

// With bounds ‖x‖ is known from the start, and up to Ceres 2.1 that is enough.
TEST(Options22, parameter_tolerance_with_bounds) {
  Line line(9.99);
  line.problem.SetParameterLowerBound(line.x, 0, -100.0);
  Options options = Small();
  options.parameter_tolerance = 0.5;
  const Summary summary = Solve(options, &line.problem).summary;
  EXPECT_TRUE(StartsWith(summary.message, "Parameter tolerance reached. Relative step_norm: "))
      << summary.message;
  const bool waits = kRelease >= 202;
  EXPECT_EQ(summary.iterations.size(), waits ? 2u : 1u);
  EXPECT_EQ(line.x[0] == 9.99, !waits);
}

TEST(Options22, use_inner_iterations) {
  Bundle bundle;
  Options options = Schur();
  options.use_inner_iterations = true;
  const Summary summary = Solve(options, &bundle.problem, Solver::kAnyone).summary;
  EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE);
  EXPECT_TRUE(summary.inner_iterations_given);
  EXPECT_TRUE(summary.inner_iterations_used);
  EXPECT_GE(summary.num_inner_iteration_steps, 0);
}

TEST(Options22, inner_iteration_ordering) {
  for (const bool used : {false, true}) {
    Bundle bundle;
    Options options = Schur();
    options.use_inner_iterations = used;
    options.inner_iteration_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    for (double* point : bundle.points) {
      options.inner_iteration_ordering->AddElementToGroup(point, 0);
    }
    const Summary summary =
        Solve(options, &bundle.problem, used ? Solver::kAnyone : Solver::kOurs).summary;
    EXPECT_EQ(summary.inner_iterations_given, used);
    EXPECT_EQ(summary.inner_iteration_ordering_given, std::vector<int>{8});
    EXPECT_EQ(summary.inner_iteration_ordering_used, std::vector<int>{8});
  }
}

TEST(Options22, inner_iteration_tolerance) {
  for (const bool used : {false, true}) {
    Bundle bundle;
    Options options = Schur();
    options.use_inner_iterations = used;
    options.inner_iteration_tolerance = 0.9;
    const Summary summary =
        Solve(options, &bundle.problem, used ? Solver::kAnyone : Solver::kOurs).summary;
    EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE);
  }
}

}  // namespace
}  // namespace conformance
