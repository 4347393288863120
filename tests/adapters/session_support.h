#pragma once

#include <functional>

#include <ceres/problem.h>
#include <ceres/sized_cost_function.h>
#include <ceres/solver.h>
#include <gtest/gtest.h>

#include "inceres/ceres/session.h"
#include "support/ceres_manifolds.h"

namespace inceres::testing {

/// r = weight (x − target) in one dimension, with everything in the test's hands, and counts of its
/// calls.
class Pull : public ceres::SizedCostFunction<1, 1> {
 public:
  Pull(double pull_target, double pull_weight) : target(pull_target), weight(pull_weight) {}
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    ++(jacobians == nullptr ? num_cost_only_calls : num_jacobian_calls);
    if (on_call) {
      on_call();
    }
    residuals[0] = jacobians == nullptr && lies ? 1.0 : weight * (parameters[0][0] - target);
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      jacobians[0][0] = weight;
    }
    return !fails;
  }

  double target;
  double weight;
  bool lies = false;  // cost-only calls give 1
  bool fails = false;
  std::function<void()> on_call;
  mutable int num_cost_only_calls = 0;
  mutable int num_jacobian_calls = 0;
};

/// A problem that owns nothing: objects live on, and change, in the test's hands.
inline ceres::Problem::Options Borrowing() {
  ceres::Problem::Options options;
  options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  manifolds::Borrow(&options);
  return options;
}

/// Every solve of a session incremental, small as tests' problems are.
inline SessionOptions AlwaysIncremental() {
  SessionOptions options;
  options.exact_windows = false;
  return options;
}

/// A session with what its last solve told.
struct Session {
  explicit Session(bool verify = true) : session(MakeOptions(verify)) {}
  static SessionOptions MakeOptions(bool verify) {
    SessionOptions options = AlwaysIncremental();
    options.verify_cached_factors = verify;
    return options;
  }

  void Solve(ceres::Problem* problem,
             const ceres::Solver::Options& given = ceres::Solver::Options()) {
    ceres::Solver::Options options = given;
    options.logging_type = ceres::SILENT;
    options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
    options.function_tolerance = 1e-12;
    SolveOptions strict;
    strict.strict = true;
    session.Solve(options, problem, &summary, strict, &report);
  }
  const ProblemChanges& changes() const { return report.changes; }

  CeresSession session;
  ceres::Solver::Summary summary;
  SolveReport report;
};

/// Two pulls on one number: at 1 with weight 1, at 4 with weight 2, so it ends at 3.4.
struct Tug {
  explicit Tug(bool verify = true) : session(verify), problem(Borrowing()) {
    first = problem.AddResidualBlock(&a, nullptr, &x);
    problem.AddResidualBlock(&b, nullptr, &x);
    session.Solve(&problem);
    EXPECT_NEAR(x, 3.4, 1e-6);
    EXPECT_EQ(session.changes().num_added_factors, 2);
  }
  void Solve() { session.Solve(&problem); }

  Pull a{1.0, 1.0};
  Pull b{4.0, 2.0};
  double x = 0.0;
  Session session;
  ceres::Problem problem;
  ceres::ResidualBlockId first = nullptr;
};

}  // namespace inceres::testing
