// The life of a session: failures, stock in between, other problems, other options.
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <stdexcept>
#include <vector>

#include <gtest/gtest.h>

#include "adapters/session_support.h"
#include "adapters/test_problems.h"

namespace inceres {
namespace {

using testing::Borrowing;
using testing::Pull;
using testing::Session;
using testing::Tug;

// Of a block from the first number of another.
ceres::CostFunction* Distance(int size) {
  return new lambdas::Formula(size, {size, 3}, [=](double const* const* x, double* r, double** J) {
    for (int k = 0; k < size; ++k) {
      r[k] = x[0][k] - x[1][0];
      J[0][k * size + k] = 1.0;
    }
    return true;
  });
}

// Two numbers of a chain in which each follows the square of the one before: a curved valley.
lambdas::Formula Valley() {
  return {2, {1, 1}, [](double const* const* x, double* residuals, double** jacobians) {
            residuals[0] = 10.0 * (x[1][0] - x[0][0] * x[0][0]);
            residuals[1] = 1.0 - x[0][0];
            jacobians[0][0] = -20.0 * x[0][0];
            jacobians[0][1] = -1.0;
            jacobians[1][0] = 10.0;
            return true;
          }};
}

// x³ − 2x = 5, and no Jacobian beyond 2.
lambdas::Formula Cubic() {
  return {1, {1}, [](double const* const* x, double* residuals, double** jacobians) {
            residuals[0] = x[0][0] * x[0][0] * x[0][0] - 2.0 * x[0][0] - 5.0;
            jacobians[0][0] = x[0][0] > 2.0 ? std::numeric_limits<double>::quiet_NaN()
                                            : 3.0 * x[0][0] * x[0][0] - 2.0;
            return true;
          }};
}

// Ceres takes 39 iterations of the 50. What the batch solver has left is known at its values only,
// not at those that the user puts there.
TEST(Session, TheSameStartIsSolvedAsWellAgain) {
  constexpr int kChains = 20, kLength = 25;
  std::vector<double> x(kChains * kLength);
  auto valley = Valley();
  ceres::Problem problem(Borrowing());
  for (int k = 0; k < kChains * kLength; ++k) {
    if (k % kLength != 0) {
      problem.AddResidualBlock(&valley, nullptr, &x[static_cast<std::size_t>(k - 1)],
                               &x[static_cast<std::size_t>(k)]);
    }
  }
  CeresSession session(testing::AlwaysIncremental());
  for (int solve = 0; solve < 3; ++solve) {
    std::fill(x.begin(), x.end(), -1.2);
    ceres::Solver::Options options;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    session.Solve(options, &problem, &summary);
    EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE) << solve << summary.message;
    EXPECT_LT(summary.final_cost, 1e-12) << solve;
  }
}

// Of a solve that goes on after its incremental steps.
TEST(Session, OptionsThatACallbackChangesAreThoseOfTheNextSolve) {
  class Meddler final : public ceres::IterationCallback {
   public:
    explicit Meddler(ceres::Solver::Options* options) : options_(*options) {}
    ceres::CallbackReturnType operator()(const ceres::IterationSummary& /*summary*/) override {
      options_.max_num_iterations = 1;
      options_.function_tolerance = 1.0;
      return ceres::SOLVER_CONTINUE;
    }

   private:
    ceres::Solver::Options& options_;
  };
  double last_cost[2];
  for (const bool meddles : {false, true}) {
    std::vector<double> x(25, -1.2);
    auto valley = Valley();
    ceres::Problem problem(Borrowing());
    for (std::size_t k = 1; k < x.size(); ++k) {
      problem.AddResidualBlock(&valley, nullptr, &x[k - 1], &x[k]);
    }
    ceres::Solver::Options options;
    options.logging_type = ceres::SILENT;
    Meddler meddler(&options);
    if (meddles) {
      options.callbacks.push_back(&meddler);
    }
    ceres::Solver::Summary summary;
    CeresSession session(testing::AlwaysIncremental());
    session.Solve(options, &problem, &summary);
    EXPECT_GT(summary.iterations.size(), 26u);
    last_cost[meddles ? 1 : 0] = summary.final_cost;
  }
  EXPECT_NEAR(last_cost[0], last_cost[1], 1e-12);
}

TEST(Session, HoweverItEndsReportsTheCostOfTheMemoryThatItLeaves) {
  std::vector<double> x(200);
  for (std::size_t k = 0; k < x.size(); ++k) {
    x[k] = 1.5 + 0.001 * static_cast<double>(k);
  }
  auto cubic = Cubic();
  ceres::Problem problem(Borrowing());
  for (double& value : x) {
    problem.AddResidualBlock(&cubic, nullptr, &value);
  }
  CeresSession session(testing::AlwaysIncremental());
  ceres::Solver::Options options;
  options.logging_type = ceres::SILENT;
  for (int solve = 0; solve < 4; ++solve) {
    x[3] = solve >= 2 ? 1.9 : x[3];
    ceres::Solver::Summary summary;
    session.Solve(options, &problem, &summary);
    double cost = 0.0;
    ASSERT_TRUE(problem.Evaluate({}, &cost, nullptr, nullptr, nullptr));
    EXPECT_NEAR(summary.final_cost, cost, 1e-9 * cost) << solve << summary.message;
  }
}

TEST(Session, ResetStartsFromNothing) {
  Tug tug;
  tug.session.session.Reset();
  tug.Solve();
  EXPECT_EQ(tug.session.changes().num_added_factors, 2);
  EXPECT_NEAR(tug.x, 3.4, 1e-6);
}

// What it has learned of windows and modes, too: a small problem is solved exactly until it has
// lived for a while.
TEST(Session, ResetForgetsThatAProblemIsNoWindow) {
  auto powell = testing::MakePowell();
  CeresSession session;
  ceres::Solver::Options options;
  options.logging_type = ceres::SILENT;
  const auto is_exact = [&] {
    ceres::Solver::Summary summary;
    SolveReport report;
    session.Solve(options, &powell->problem, &summary, {}, &report);
    return report.exact_reason.find("window") != std::string::npos;
  };
  EXPECT_TRUE(is_exact());
  int num_solves = 1;
  while (is_exact()) {
    ASSERT_LT(++num_solves, 100);
  }
  session.Reset();
  EXPECT_TRUE(is_exact());
}

// A Schur solver whose landmarks are all constant is DENSE_QR, in Ceres and here.
TEST(Session, AnExactSolveTakesALargeDenseQr) {
  constexpr int kSize = 10;
  std::vector<std::vector<double>> blocks(60, std::vector<double>(kSize, 1.0));
  std::vector<double> fixed(3, 1.0);
  ceres::Problem problem;
  problem.AddParameterBlock(fixed.data(), 3);
  problem.SetParameterBlockConstant(fixed.data());
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.logging_type = ceres::SILENT;
  options.max_num_iterations = 0;
  options.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  options.linear_solver_ordering->AddElementToGroup(fixed.data(), 0);
  for (std::vector<double>& block : blocks) {
    options.linear_solver_ordering->AddElementToGroup(block.data(), 1);
    for (int k = 0; k < 12; ++k) {
      problem.AddResidualBlock(Distance(kSize), nullptr, block.data(), fixed.data());
    }
  }
  CeresSession session;
  ceres::Solver::Summary summary;
  SolveReport report;
  session.Solve(options, &problem, &summary, {}, &report);
  EXPECT_FALSE(report.used_stock) << report.fallback_reason;
  EXPECT_EQ(summary.linear_solver_type_used, ceres::DENSE_QR);
}

// Who says that nothing was edited, and errs, is not believed where the number of blocks says
// otherwise.
TEST(Session, APromiseThatTheProblemIsUneditedIsChecked) {
  Tug tug;
  Pull c{10.0, 2.0};
  tug.problem.AddResidualBlock(&c, nullptr, &tug.x);
  SolveOptions asked;
  SolveReport report;
  asked.problem_unedited = true;
  ceres::Solver::Options options;
  options.logging_type = ceres::SILENT;
  options.function_tolerance = 1e-12;
  options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
  tug.session.session.Solve(options, &tug.problem, &tug.session.summary, asked, &report);
  EXPECT_EQ(report.changes.num_added_factors, 1);
  EXPECT_NEAR(tug.x, (1.0 + 4.0 * 4.0 + 4.0 * 10.0) / 9.0, 1e-6);
}

TEST(Session, AFailureLeavesMemoryAsItWasAndForgets) {
  Tug tug;
  tug.b.fails = true;
  tug.x = 7.0;
  tug.Solve();
  EXPECT_EQ(tug.session.summary.termination_type, ceres::FAILURE);
  EXPECT_FALSE(tug.session.summary.message.empty());
  EXPECT_EQ(tug.session.summary.final_cost, tug.session.summary.initial_cost);
  EXPECT_EQ(tug.x, 7.0);
  tug.b.fails = false;
  tug.Solve();
  EXPECT_EQ(tug.session.changes().num_added_factors, 2);
  EXPECT_NEAR(tug.x, 3.4, 1e-6);
}

// The residual is zero there, which proves nothing: the session knows it by another place.
TEST(Session, AFunctionThatBeginsToRefuseWhereItIsAndNowhereElseIsAFailure) {
  class Picky final : public Pull {
   public:
    using Pull::Pull;
    bool Evaluate(double const* const* parameters, double* residuals,
                  double** jacobians) const override {
      return Pull::Evaluate(parameters, residuals, jacobians) && parameters[0][0] != refused;
    }
    double refused = HUGE_VAL;
  };
  ceres::Problem problem(Borrowing());
  Picky a(1.0, 1.0);
  Pull b(3.0, 1.0);
  double x = 5.0;
  problem.AddResidualBlock(&a, nullptr, &x);
  ceres::ResidualBlockId pull = problem.AddResidualBlock(&b, nullptr, &x);
  Session session;
  session.Solve(&problem);
  problem.RemoveResidualBlock(pull);
  session.Solve(&problem);
  ASSERT_EQ(x, 1.0);
  session.Solve(&problem);
  ASSERT_EQ(session.summary.termination_type, ceres::CONVERGENCE);
  ASSERT_EQ(session.changes().num_kept_factors, 1);
  a.refused = x;
  session.Solve(&problem);
  EXPECT_EQ(session.summary.termination_type, ceres::FAILURE);
}

// Ceres ends there with a step that is too short to change anything: that is no proof.
TEST(Session, WhereNoStepCanBeEvaluatedAClaimRestsOnRefusals) {
  std::vector<double> x = {1.0, 2.0, 3.0};
  const std::vector<double> start = x;
  lambdas::Formula rigid(3, {3},
                         [&](double const* const* at, double* residuals, double** jacobians) {
                           for (int k = 0; k < 3; ++k) {
                             residuals[k] = at[0][k] - 100.0 * k;
                             jacobians[0][4 * k] = 1.0;
                           }
                           return std::equal(start.begin(), start.end(), at[0]);
                         });
  ceres::Problem problem(Borrowing());
  problem.AddResidualBlock(&rigid, nullptr, x.data());
  Session session;
  ceres::Solver::Options options;
  options.max_num_iterations = 200;
  session.Solve(&problem, options);
  EXPECT_TRUE(session.report.update.rests_on_refusals) << session.summary.message;
  EXPECT_EQ(x, start);
}

// An automatic session that has solved exactly calls user code once more, for what it remembers.
TEST(Session, AnExceptionOutOfAnyCallOfAnAutomaticSessionLeavesMemoryAsItWas) {
  int num_thrown = 0;
  for (int good_calls = 0; good_calls < 40; ++good_calls) {
    ceres::Problem problem(Borrowing());
    Pull a(1.0, 1.0), b(0.0, 1.0);
    double x = 3.0;
    problem.AddResidualBlock(&a, nullptr, &x);
    problem.AddResidualBlock(&b, nullptr, &x);
    int num_calls = 0;
    b.on_call = [&] {
      if (num_calls++ == good_calls) {
        throw std::runtime_error("user");
      }
    };
    SessionOptions automatic;
    automatic.automatic = true;
    automatic.exact_windows = false;
    CeresSession session(automatic);
    ceres::Solver::Options options;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    for (int solve = 0; solve < 3; ++solve, a.target += 0.5) {
      const double start = x;
      try {
        session.Solve(options, &problem, &summary);
      } catch (const std::runtime_error&) {
        ++num_thrown;
        EXPECT_EQ(x, start) << "call " << good_calls << ", solve " << solve;
      }
    }
  }
  EXPECT_GT(num_thrown, 10);
}

TEST(Session, AnExceptionOutOfUserCodeLeavesMemoryAsItWasAndForgets) {
  Tug tug;
  tug.b.on_call = [] { throw std::runtime_error("user"); };
  tug.x = 7.0;
  EXPECT_THROW(tug.Solve(), std::runtime_error);
  EXPECT_EQ(tug.x, 7.0);
  tug.b.on_call = nullptr;
  tug.Solve();
  EXPECT_EQ(tug.session.changes().num_added_factors, 2);
  EXPECT_NEAR(tug.x, 3.4, 1e-6);
}

TEST(Session, StockMaySolveInBetween) {
  Tug tug;
  tug.b.target = 9.0;
  ceres::Solver::Summary summary;
  ceres::Solver::Options options;
  options.logging_type = ceres::SILENT;
  options.minimizer_type = ceres::LINE_SEARCH;
  options.function_tolerance = 1e-14;
  SolveReport report;
  tug.session.session.Solve(options, &tug.problem, &summary, {}, &report);
  EXPECT_TRUE(report.used_stock);
  EXPECT_NE(report.fallback_reason.find("LINE_SEARCH"), std::string::npos);
  EXPECT_NEAR(tug.x, 7.4, 1e-3);
  tug.b.target = 4.0;
  tug.Solve();
  EXPECT_NEAR(tug.x, 3.4, 1e-6);
}

TEST(Session, GoesFromOneProblemToAnother) {
  Tug tug;
  Pull c(-1.0, 1.0);
  double y = 0.0;
  ceres::Problem other(Borrowing());
  other.AddResidualBlock(&c, nullptr, &y);
  tug.session.Solve(&other);
  EXPECT_NEAR(y, -1.0, 1e-6);
  EXPECT_EQ(tug.session.changes().num_removed_factors, 2);
  tug.x = 0.0;
  tug.Solve();
  EXPECT_NEAR(tug.x, 3.4, 1e-6);
}

TEST(Session, NothingIsCalledAfterSolve) {
  Tug tug;
  const int calls = tug.a.num_cost_only_calls + tug.a.num_jacobian_calls;
  tug.a.on_call = [] { ADD_FAILURE() << "a cost function was called outside Solve"; };
  tug.session.session.Forget(&tug.a);
  tug.session.session.Reset();
  EXPECT_EQ(tug.a.num_cost_only_calls + tug.a.num_jacobian_calls, calls);
}

TEST(Session, OptionsMayDifferFromSolveToSolve) {
  auto powell = testing::MakePowell();
  Session session;
  ceres::Solver::Options options;
  options.max_num_iterations = 0;
  session.Solve(&powell->problem, options);
  EXPECT_EQ(session.summary.termination_type, ceres::NO_CONVERGENCE);
  EXPECT_EQ(session.report.update.num_iterations, 0);
  options.max_num_iterations = 2;
  session.Solve(&powell->problem, options);
  EXPECT_EQ(session.report.update.num_iterations, 2);
  EXPECT_LT(session.summary.final_cost, session.summary.initial_cost);
}

// Ends that are not the function tolerance's have words of their own.
TEST(Session, TheMessageSaysWhichTestHasEndedTheSolve) {
  double x = 2.0;
  testing::Pull pulls[3] = {{0.0, 1.0}, {1.0, 1.0}, {2.0, 1.0}};
  ceres::Problem problem(testing::Borrowing());
  for (testing::Pull& pull : pulls) {
    problem.AddResidualBlock(&pull, nullptr, &x);
  }
  testing::Session session;
  session.Solve(&problem);
  EXPECT_EQ(session.summary.message.find("Function tolerance reached. |cost_change|/cost: "), 0U)
      << session.summary.message;
  session.Solve(&problem);
  EXPECT_EQ(session.summary.termination_type, ceres::CONVERGENCE);
  EXPECT_EQ(session.summary.message, "Nothing has changed since the last Update converged.");
}

}  // namespace
}  // namespace inceres
