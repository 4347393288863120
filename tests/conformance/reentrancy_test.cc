// docs/ceres_contract.md, "Reentrancy and threads": solves within solves and beside solves.
#include <atomic>
#include <thread>

#include "conformance/support.h"

namespace conformance {
namespace {

TEST(Reentrancy53, solve_within_a_cost_function) {
  World outer;
  double* x = outer.Add({0.0});
  int num_inner = 0;
  // r = x − the minimum of an inner problem, which has 10 − y.
  auto* cost = new Cost(1, {1}, [&](double const* const* p, double* residuals, double** jacobians) {
    Line inner;
    Summary summary;
    ceres::Solve(Small(), &inner.problem, &summary);
    EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE);
    EXPECT_EQ(summary.iterations.size(), 3u);
    ++num_inner;
    residuals[0] = p[0][0] - inner.x[0];
    if (jacobians != nullptr) {
      jacobians[0][0] = 1.0;
    }
    return true;
  });
  outer.problem.AddResidualBlock(cost, nullptr, x);
  const Summary summary = Solve(Small(), &outer.problem).summary;
  EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE);
  EXPECT_NEAR(x[0], 10.0, 1e-6);
  EXPECT_EQ(num_inner, summary.num_residual_evaluations + summary.num_jacobian_evaluations);
}

TEST(Reentrancy53, solve_within_a_callback) {
  Rosenbrock outer;
  int num_inner = 0;
  Callback callback([&](const ceres::IterationSummary&) {
    Bundle inner;
    Summary summary;
    ceres::Solve(Schur(), &inner.problem, &summary);
    num_inner += summary.termination_type == ceres::CONVERGENCE ? 1 : 0;
    return ceres::SOLVER_CONTINUE;
  });
  Options options = Small();
  options.callbacks.push_back(&callback);
  const Summary summary = Solve(options, &outer.problem).summary;
  EXPECT_EQ(num_inner, static_cast<int>(summary.iterations.size()));
  EXPECT_NEAR(outer.x[0], 1.0, 1e-6);
}

// Threads that solve, stop and fail, each with what it gets alone.
TEST(Reentrancy53, solves_in_parallel_threads) {
  std::atomic<int> num_right{0};
  const auto work = [&](int which) {
    for (int round = 0; round < 20; ++round) {
      Summary summary;
      if (which % 2 == 0) {
        Bundle bundle(3, 8);
        Options options = Schur();
        options.num_threads = 1 + which / 2;
        ceres::Solve(options, &bundle.problem, &summary);
        num_right += summary.termination_type == ceres::CONVERGENCE &&
                     std::abs(summary.final_cost - 3.36913424893) < 1e-8;
      } else {
        Line line;
        line.problem.AddResidualBlock(new Cost(1, {1}, [](auto...) { return false; }), nullptr,
                                      line.x);
        ceres::Solve(Small(), &line.problem, &summary);
        num_right += summary.termination_type == ceres::FAILURE && line.x[0] == 0.5;
      }
    }
  };
  std::vector<std::thread> threads;
  for (int which = 0; which < 4; ++which) {
    threads.emplace_back(work, which);
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  EXPECT_EQ(num_right, 80);
}

// A Problem solved by one thread after another, and by stock's other consumers of it in between.
TEST(Reentrancy53, the_problem_can_be_used_as_ever_after_a_solve) {
  Bundle bundle;
  const Summary first = Solve(Schur(), &bundle.problem).summary;
  double cost = 0.0;
  std::vector<double> gradient;
  EXPECT_TRUE(bundle.problem.Evaluate(ceres::Problem::EvaluateOptions(), &cost, nullptr, &gradient,
                                      nullptr));
  ExpectClose(cost, first.final_cost, 1e-12);
  for (const double entry : gradient) {
    EXPECT_NEAR(entry, 0.0, 1e-2);
  }
  ceres::Covariance covariance((ceres::Covariance::Options()));
  const std::vector<std::pair<const double*, const double*>> pairs = {
      {bundle.points[0], bundle.points[0]}};
  EXPECT_TRUE(covariance.Compute(pairs, &bundle.problem));
  std::thread([&] {
    Summary second;
    ceres::Solve(Schur(), &bundle.problem, &second);
    EXPECT_EQ(second.termination_type, ceres::CONVERGENCE);
    EXPECT_LE(second.final_cost, first.final_cost);
  }).join();
}

}  // namespace
}  // namespace conformance
