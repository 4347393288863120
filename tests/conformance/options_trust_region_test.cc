// docs/ceres_contract.md, "Trust-region options": the trust region, up to its radii. Test names are
// the fields'.
#include <atomic>
#include <chrono>
#include <thread>

#include "conformance/support.h"

namespace conformance {
namespace {

TEST(Options22, trust_region_strategy_type) {
  for (const auto strategy : {ceres::LEVENBERG_MARQUARDT, ceres::DOGLEG}) {
    Line line;
    Options options = Small();
    options.trust_region_strategy_type = strategy;
    const Summary summary = Solve(options, &line.problem).summary;
    EXPECT_EQ(summary.trust_region_strategy_type, strategy);
    ASSERT_GE(summary.iterations.size(), 2u);
    // Levenberg–Marquardt triples its radius; the Gauss–Newton step is too short to widen
    // Dog-Leg's.
    ExpectClose(summary.iterations[1].trust_region_radius, strategy == ceres::DOGLEG ? 1e4 : 3e4);
    EXPECT_NEAR(line.x[0], 10.0, 1e-6);
  }
}

// The configuration of most VIO systems.
TEST(Options22, trust_region_strategy_type_dogleg_with_dense_schur) {
  Bundle bundle;
  Options options = Schur();
  options.trust_region_strategy_type = ceres::DOGLEG;
  const Summary summary = Solve(options, &bundle.problem).summary;
  EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE);
  EXPECT_EQ(summary.linear_solver_type_used, ceres::DENSE_SCHUR);
  EXPECT_TRUE(StartsWith(summary.message, "Function tolerance reached."));
}

TEST(Options22, dogleg_type) {
  for (const auto type : {ceres::TRADITIONAL_DOGLEG, ceres::SUBSPACE_DOGLEG}) {
    Rosenbrock rosenbrock;
    Options options = Small();
    options.trust_region_strategy_type = ceres::DOGLEG;
    options.dogleg_type = type;
    options.initial_trust_region_radius = 1.0;
    const Summary summary = Solve(options, &rosenbrock.problem).summary;
    EXPECT_EQ(summary.dogleg_type, type);
    EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE);
    EXPECT_NEAR(rosenbrock.x[1], 1.0, 1e-6);
  }
}

TEST(Options22, use_nonmonotonic_steps) {
  Rosenbrock rosenbrock;
  Options options = Small();
  options.use_nonmonotonic_steps = true;
  const Summary summary = Solve(options, &rosenbrock.problem).summary;
  int num_nonmonotonic = 0;
  for (const ceres::IterationSummary& iteration : summary.iterations) {
    num_nonmonotonic += iteration.step_is_nonmonotonic ? 1 : 0;
  }
  EXPECT_GT(num_nonmonotonic, 0);
  EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE);
}

// A window of 0 accepted steps would be monotone; with 1 the reference cost follows after one step
// above the minimum.
TEST(Options22, max_consecutive_nonmonotonic_steps) {
  std::size_t sizes[2];
  for (const int window : {1, 5}) {
    Rosenbrock rosenbrock;
    Options options = Small();
    options.use_nonmonotonic_steps = true;
    options.max_consecutive_nonmonotonic_steps = window;
    const Summary summary = Solve(options, &rosenbrock.problem).summary;
    EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE);
    sizes[window == 5] = summary.iterations.size();
  }
  EXPECT_EQ(sizes[0], 21u);
  EXPECT_EQ(sizes[1], 22u);
}

TEST(Options22, max_num_iterations) {
  Rosenbrock rosenbrock;
  Options options = Small();
  options.max_num_iterations = 3;
  const Summary summary = Solve(options, &rosenbrock.problem).summary;
  EXPECT_EQ(summary.termination_type, ceres::NO_CONVERGENCE);
  EXPECT_EQ(summary.message, "Maximum number of iterations reached. Number of iterations: 3.");
  EXPECT_EQ(summary.iterations.size(), 4u);
}

// Iteration 0 is evaluated and told of; then it ends, although the gradient already satisfies its
// tolerance.
TEST(Options22, max_num_iterations_zero) {
  Line line(10.0);
  Options options = Small();
  options.max_num_iterations = 0;
  int num_callbacks = 0;
  Callback callback([&](const ceres::IterationSummary&) {
    ++num_callbacks;
    return ceres::SOLVER_CONTINUE;
  });
  options.callbacks.push_back(&callback);
  const Summary summary = Solve(options, &line.problem).summary;
  EXPECT_EQ(summary.termination_type, ceres::NO_CONVERGENCE);
  EXPECT_EQ(summary.message, "Maximum number of iterations reached. Number of iterations: 0.");
  EXPECT_EQ(summary.num_jacobian_evaluations, 1);
  EXPECT_EQ(summary.num_residual_evaluations, 0);
  EXPECT_EQ(num_callbacks, 1);
}

// Looked at between iterations only; the callback's time counts.
TEST(Options22, max_solver_time_in_seconds) {
  Rosenbrock rosenbrock;
  Options options = Small();
  options.max_solver_time_in_seconds = 0.05;
  Callback callback([](const ceres::IterationSummary& summary) {
    std::this_thread::sleep_for(std::chrono::milliseconds(summary.iteration == 2 ? 60 : 0));
    return ceres::SOLVER_CONTINUE;
  });
  options.callbacks.push_back(&callback);
  const Summary summary = Solve(options, &rosenbrock.problem).summary;
  EXPECT_EQ(summary.termination_type, ceres::NO_CONVERGENCE);
  EXPECT_TRUE(StartsWith(summary.message, "Maximum solver time reached. Total solver time: "))
      << summary.message;
  EXPECT_NE(summary.message.find(" >= 5.000000e-02."), std::string::npos) << summary.message;
  EXPECT_EQ(summary.iterations.size(), 3u);
}

// Each call waits for another: with as few residual blocks as these both threads are at work, and
// never a third.
TEST(Options22, num_threads_of_two) {
  if (std::thread::hardware_concurrency() < 2) {
    GTEST_SKIP() << "one processor";
  }
  Bundle bundle;
  std::atomic<int> inside{0};
  std::atomic<int> most{0};
  for (int k = 0; k < 64; ++k) {
    bundle.problem.AddResidualBlock(
        new Cost(1, {6},
                 [&](double const* const*, double* residuals, double** jacobians) {
                   const int now = ++inside;
                   for (int seen = most; seen < now && !most.compare_exchange_weak(seen, now);) {
                   }
                   for (int wait = 0; wait < 1000 && most < 2; ++wait) {
                     std::this_thread::sleep_for(std::chrono::milliseconds(1));
                   }
                   residuals[0] = 0.0;
                   if (jacobians != nullptr && jacobians[0] != nullptr) {
                     std::fill_n(jacobians[0], 6, 0.0);
                   }
                   --inside;
                   return true;
                 }),
        nullptr, bundle.cameras[0]);
  }
  Options options = Schur();
  options.num_threads = 2;
  const Summary summary = Solve(options, &bundle.problem).summary;
  EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE);
  EXPECT_EQ(summary.num_threads_used, 2);
  EXPECT_EQ(most, 2);
}

TEST(Options22, num_threads_above_the_machine) {
  Bundle bundle;
  Options options = Schur();
  options.num_threads = 4000;
  const Outcome outcome = Solve(options, &bundle.problem);
  const int available = static_cast<int>(std::thread::hardware_concurrency());
  EXPECT_EQ(outcome.summary.num_threads_given, 4000);
  EXPECT_EQ(outcome.summary.num_threads_used, available);
  ASSERT_EQ(outcome.warnings.size(), 1u);
  EXPECT_EQ(outcome.warnings[0],
            "Specified options.num_threads: 4000 exceeds maximum available from the threading "
            "model Ceres "
            "was compiled with: " +
                std::to_string(available) + ".  Bounding to maximum number available.");
}

TEST(Options22, initial_trust_region_radius) {
  Line line;
  Options options = Small();
  options.initial_trust_region_radius = 1.0;
  const Summary summary = Solve(options, &line.problem).summary;
  EXPECT_EQ(summary.iterations[0].trust_region_radius, 1.0);
  ExpectClose(summary.iterations[1].cost, 0.5 * 4.75 * 4.75);  // (1 + 1) δ = 9.5
}

TEST(Options22, max_trust_region_radius) {
  Line line;
  Options options = Small();
  options.max_trust_region_radius = 2e4;
  EXPECT_EQ(Solve(options, &line.problem).summary.iterations[1].trust_region_radius, 2e4);
}

TEST(Options22, max_trust_region_radius_is_not_that_of_dogleg) {
  Line line;
  Options options = Small();
  options.trust_region_strategy_type = ceres::DOGLEG;
  options.initial_trust_region_radius = 1.0;
  options.max_trust_region_radius = 1.0;
  // The step is 1 long in the scaled space, D = s·|J| = 1/2, so 2 in x; the radius becomes three
  // times the step's length.
  const Summary summary = Solve(options, &line.problem).summary;
  ExpectClose(summary.iterations[1].trust_region_radius, 3.0);
}

// Every trial point fails: the radius shrinks to 5e3, 1.25e3, 156.25.
TEST(Options22, min_trust_region_radius) {
  World world;
  double* x = world.Add({0.5});
  world.problem.AddResidualBlock(OnlyAt(0.5), nullptr, x);
  Options options = Small();
  options.min_trust_region_radius = 1e3;
  const Summary summary = Solve(options, &world.problem).summary;
  EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE);
  EXPECT_EQ(
      summary.message,
      "Minimum trust region radius reached. Trust region radius: 1.562500e+02 <= 1.000000e+03");
  EXPECT_EQ(summary.iterations.size(), 4u);
  EXPECT_EQ(x[0], 0.5);
}

}  // namespace
}  // namespace conformance
