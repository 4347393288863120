// A residual block that cannot be evaluated is named by what its author can find: addresses and
// values.
#include <cmath>
#include <limits>
#include <sstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "adapters/captured_log.h"
#include "adapters/session_support.h"
#include "adapters/test_problems.h"
#include "inceres/ceres/session.h"
#include "inceres/ceres/solve.h"

namespace inceres {
namespace {

using ::testing::AllOf;
using ::testing::Each;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::SizeIs;

using Spoil = std::function<bool(double* residuals, double** jacobians)>;

// r = (x0 + 2 y0, x1 + y1, x0 y0), of blocks of two, then spoiled.
ceres::CostFunction* SpoiledCost(const Spoil* spoil) {
  return new lambdas::Cost(3, {2, 2}, [=](double const* const* parameters, double* r, double** J) {
    const double* x = parameters[0];
    const double* y = parameters[1];
    r[0] = x[0] + 2.0 * y[0];
    r[1] = x[1] + y[1];
    r[2] = x[0] * y[0];
    const double J_x[] = {1.0, 0.0, 0.0, 1.0, y[0], 0.0};
    const double J_y[] = {2.0, 0.0, 0.0, 1.0, x[0], 0.0};
    if (J != nullptr && J[0] != nullptr) {
      std::copy_n(J_x, 6, J[0]);
    }
    if (J != nullptr && J[1] != nullptr) {
      std::copy_n(J_y, 6, J[1]);
    }
    return *spoil == nullptr || (*spoil)(r, J);
  });
}

std::string Address(const void* object) {
  std::ostringstream text;
  text << object;
  return text.str();
}

struct SpoiledProblem {
  explicit SpoiledProblem(Spoil given) : spoil(std::move(given)), cost(SpoiledCost(&spoil)) {
    problem.AddResidualBlock(new testing::TargetCost({1.0, 1.0}), nullptr, x);
    problem.AddResidualBlock(cost, nullptr, x, y);
  }
  std::string ExpectedPlace() const {
    return "; cost function " + Address(cost) + "; at parameter block " + Address(x) +
           " = (1.5, -2), parameter block " + Address(y) + " = (0.25, 1e+300)";
  }
  double x[2] = {1.5, -2.0};
  double y[2] = {0.25, 1e300};
  Spoil spoil;
  ceres::CostFunction* cost;
  ceres::Problem problem;
};

ceres::Solver::Options Options(ceres::LoggingType logging = ceres::SILENT) {
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
  options.logging_type = logging;
  return options;
}

struct Case {
  Spoil spoil;
  std::string what;
};

std::vector<Case> Cases(const SpoiledProblem* const* problem) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  constexpr double kInf = std::numeric_limits<double>::infinity();
  const auto block = [problem](bool second) {
    return "parameter block " + Address(second ? (*problem)->y : (*problem)->x);
  };
  std::vector<Case> cases = {
      {[](double*, double**) { return false; }, ": the cost function returned false"},
      {[](double* r, double**) { return r[1] = kNan, true; }, "written: residual 1 is nan"},
      {[](double* r, double**) { return r[2] = -kInf, true; }, "written: residual 2 is -inf"},
      {[](double*, double** J) { return J != nullptr ? (J[1][3] = kInf, true) : true; },
       "written: entry (1, 1) of the Jacobian by " + block(true) + " is inf"},
      {[](double*, double** J) { return J != nullptr ? (J[0][4] = kNan, true) : true; },
       "written: entry (2, 0) of the Jacobian by " + block(false) + " is nan"},
  };
  return cases;
}

// How a solve of a problem that fails is reported.
template <typename SolveSpoiled>
void ExpectNamed(const SolveSpoiled& solve) {
  SpoiledProblem problem(nullptr);
  const SpoiledProblem* self = &problem;
  for (const Case& spoiled : Cases(&self)) {
    problem.spoil = spoiled.spoil;
    const testing::CapturedLog log;
    SolveOptions asked;
    SolveReport report;
    asked.strict = true;
    ceres::Solver::Summary summary;
    solve(Options(), &problem.problem, &summary, asked, &report);
    EXPECT_EQ(summary.termination_type, ceres::FAILURE);
    EXPECT_EQ(summary.message, "Residual and Jacobian evaluation failed.");
    EXPECT_THAT(report.core.detail,
                AllOf(HasSubstr(spoiled.what), HasSubstr(problem.ExpectedPlace())));
    EXPECT_THAT(log.messages(), ::testing::Contains(HasSubstr(report.core.detail)));
    EXPECT_EQ(problem.x[0], 1.5);
  }
}

TEST(FailureReport, OfExactMode) {
  ExpectNamed([](const auto& options, auto* problem, auto* summary, const auto& asked,
                 auto* report) { Solve(options, problem, summary, asked, report); });
}

TEST(FailureReport, OfIncrementalMode) {
  ExpectNamed([](const auto& options, auto* problem, auto* summary, auto asked, auto* report) {
    asked.mode = SolveMode::kIncremental;
    inceres::Solve(options, problem, summary, asked, report);
  });
}

TEST(FailureReport, OfASession) {
  ExpectNamed(
      [](const auto& options, auto* problem, auto* summary, const auto& asked, auto* report) {
        CeresSession session{inceres::testing::AlwaysIncremental()};
        session.Solve(options, problem, summary, asked, report);
      });
}

TEST(FailureReport, OfConstantBlocksToo) {
  SpoiledProblem problem([](double*, double**) { return false; });
  problem.problem.SetParameterBlockConstant(problem.y);
  for (const SolveMode mode : {SolveMode::kExact, SolveMode::kIncremental}) {
    const testing::CapturedLog log;
    SolveOptions asked;
    SolveReport report;
    asked.mode = mode;
    ceres::Solver::Summary summary;
    inceres::Solve(Options(), &problem.problem, &summary, asked, &report);
    EXPECT_THAT(report.core.detail, HasSubstr(problem.ExpectedPlace()));
  }
}

TEST(FailureReport, ManyBlocksOfManyValuesStayReadable) {
  std::vector<std::vector<double>> blocks(30, std::vector<double>(50, 0.5));
  std::vector<double*> pointers;
  for (std::vector<double>& block : blocks) {
    pointers.push_back(block.data());
  }
  ceres::Problem problem;
  problem.AddResidualBlock(new testing::ShapeOnlyCost(1, std::vector<int>(30, 50)), nullptr,
                           pointers);
  const testing::CapturedLog log;
  SolveReport report;
  ceres::Solver::Summary summary;
  inceres::Solve(Options(), &problem, &summary, {}, &report);
  EXPECT_THAT(report.core.detail, HasSubstr("= (0.5, 0.5, 0.5, 0.5, 0.5, 0.5, …)"));
  EXPECT_LT(report.core.detail.size(), 1000U);
}

// (√x − 10)² cannot be evaluated at x ≤ 0, where the first steps from 900 go.
ceres::CostFunction* RootCost() {
  return new lambdas::Formula(1, {1}, [](double const* const* x, double* r, double** J) {
    r[0] = std::sqrt(x[0][0]) - 10.0;
    J[0][0] = 0.5 / std::sqrt(x[0][0]);
    return x[0][0] > 0.0;
  });
}

template <typename SolveRoot>
std::vector<std::string> LogOfRoot(ceres::LoggingType logging, const SolveRoot& solve) {
  double x = 900.0;
  ceres::Problem problem;
  problem.AddResidualBlock(RootCost(), nullptr, &x);
  const testing::CapturedLog log;
  ceres::Solver::Summary summary;
  solve(Options(logging), &problem, &summary);
  EXPECT_TRUE(summary.IsSolutionUsable()) << summary.message;
  EXPECT_GE(summary.num_unsuccessful_steps, 2);
  EXPECT_NEAR(x, 100.0, 1.0);
  return log.messages();
}

TEST(FailureReport, AStepThatFailsToEvaluateIsAWarningOnceASolve) {
  const auto stock = [](const auto& options, auto* problem, auto* summary) {
    ceres::Solve(options, problem, summary);
  };
  const std::string words = "Step failed to evaluate. Treating it as a step with infinite cost";
  const std::vector<std::string> of_stock = LogOfRoot(ceres::PER_MINIMIZER_ITERATION, stock);
  EXPECT_THAT(of_stock, AllOf(Not(IsEmpty()), Each(HasSubstr(words))));
  EXPECT_THAT(LogOfRoot(ceres::SILENT, stock), IsEmpty());
  for (const SolveMode mode : {SolveMode::kExact, SolveMode::kIncremental}) {
    std::string failed_step;
    const auto ours = [&](const auto& options, auto* problem, auto* summary) {
      SolveOptions asked;
      SolveReport report;
      asked.mode = mode;
      asked.strict = true;
      inceres::Solve(options, problem, summary, asked, &report);
      failed_step = report.core.failed_step;
    };
    const std::vector<std::string> messages = LogOfRoot(ceres::PER_MINIMIZER_ITERATION, ours);
    ASSERT_THAT(messages, SizeIs(1));
    EXPECT_THAT(messages[0], AllOf(HasSubstr(words), HasSubstr("the cost function returned false"),
                                   HasSubstr(" = (-")));
    EXPECT_THAT(failed_step, HasSubstr("parameter block 0x"));
    EXPECT_THAT(LogOfRoot(ceres::SILENT, ours), IsEmpty());
  }
}

}  // namespace
}  // namespace inceres
