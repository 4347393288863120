// ceres::EvaluationCallback: what it is told, when, and what lies in the user's memory then, next
// to stock Ceres.
#include <cmath>

#include <ceres/version.h>
#include <gtest/gtest.h>

#include "adapters/compare_with_stock.h"
#include "support/ceres_manifolds.h"

namespace inceres {
namespace {

using testing::BothSolved;
using testing::SolveBoth;
using testing::TestProblem;
using Options = ceres::Solver::Options;

// Computes (x, y) ↦ (10 (y − x²), 1 − x) from the user's memory, as a callback does that shares
// work between cost functions.
class SharedWork : public ceres::EvaluationCallback {
 public:
  struct Call {
    bool jacobians;
    bool new_point;
    std::deque<std::vector<double>> memory;
  };

  void PrepareForEvaluation(bool evaluate_jacobians, bool new_evaluation_point) override {
    calls.push_back({evaluate_jacobians, new_evaluation_point, test->blocks});
    const double x = test->blocks[0][0];
    const double y = test->blocks[1][0];
    residuals = {10.0 * (y - x * x), 1.0 - x};
    slopes = {-20.0 * x, -1.0};
  }

  TestProblem* test = nullptr;
  std::vector<Call> calls;
  std::vector<double> residuals = {1e6, 1e6};  // what a cost function reads that was not prepared
  std::vector<double> slopes = {1.0, 1.0};
};

// Row `row` of the work above; reads no parameter of its own.
ceres::CostFunction* PreparedCost(const SharedWork* work, std::size_t row, double fail_beyond) {
  return new lambdas::Formula(1, std::vector<int>(row == 0 ? 2 : 1, 1),
                              [=](double const* const* x, double* residuals, double** jacobians) {
                                residuals[0] = work->residuals[row];
                                jacobians[0][0] = work->slopes[row];
                                if (row == 0) {
                                  jacobians[1][0] = 10.0;
                                }
                                return std::abs(x[0][0]) < fail_beyond;
                              });
}

struct CallbackCase {
  bool fixed_block = false;  // one residual block that touches only a constant
  double fail_beyond = 1e9;  // trial points with a larger |x| cannot be evaluated
  bool bounded = false;  // x at most 0.5: a line search evaluates too, and the start is projected
};

// Keeps the callbacks of both copies: stock's first.
struct Callbacks {
  std::vector<std::unique_ptr<SharedWork>> all;

  testing::Recipe Recipe(const CallbackCase& which) {
    return [this, which] {
      SharedWork* work = all.emplace_back(std::make_unique<SharedWork>()).get();
      ceres::Problem::Options options;
      options.evaluation_callback = work;
      auto test = std::make_unique<TestProblem>(options);
      work->test = test.get();
      double* x = test->Add({-1.2});
      double* y = test->Add({1.0});
      double* constant = test->Add({3.0});
      test->problem.AddResidualBlock(PreparedCost(work, 0, which.fail_beyond), nullptr, x, y);
      test->problem.AddResidualBlock(PreparedCost(work, 1, which.fail_beyond),
                                     new ceres::CauchyLoss(2.0), x);
      if (which.bounded) {
        test->problem.SetParameterUpperBound(x, 0, 0.5);
        test->problem.SetParameterUpperBound(y, 0, 0.75);
      }
      if (which.fixed_block) {
        test->problem.AddResidualBlock(new testing::TargetCost({1.0}), nullptr, constant);
        test->problem.SetParameterBlockConstant(constant);
      }
      return test;
    };
  }
};

void ExpectSameCalls(const SharedWork& stock, const SharedWork& ours) {
  ASSERT_EQ(stock.calls.size(), ours.calls.size());
  for (std::size_t k = 0; k < stock.calls.size(); ++k) {
    EXPECT_EQ(stock.calls[k].jacobians, ours.calls[k].jacobians) << "call " << k;
    EXPECT_EQ(stock.calls[k].new_point, ours.calls[k].new_point) << "call " << k;
    for (std::size_t b = 0; b < stock.calls[k].memory.size(); ++b) {
      EXPECT_NEAR(stock.calls[k].memory[b][0], ours.calls[k].memory[b][0], 1e-8)
          << "call " << k << " block " << b;
    }
  }
}

Options DenseQr() {
  Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  options.max_num_iterations = 100;
  return options;
}

class EvaluationCallbacks : public ::testing::TestWithParam<CallbackCase> {};

TEST_P(EvaluationCallbacks, AreToldWhatStockTells) {
  for (const bool dogleg : {false, true}) {
    Callbacks callbacks;
    Options options = DenseQr();
    options.trust_region_strategy_type = dogleg ? ceres::DOGLEG : ceres::LEVENBERG_MARQUARDT;
    const BothSolved both = SolveBoth(callbacks.Recipe(GetParam()), options);
    ExpectSameSummary(both, 1e-9, true);
    ExpectSameParameters(both, 1e-8);
    ExpectSameCalls(*callbacks.all[0], *callbacks.all[1]);
    EXPECT_GT(both.ours.num_unsuccessful_steps + both.ours.num_line_search_steps, 0)
        << "the test wants refused points too";
    const int extra = GetParam().fixed_block ? 1 : 0;
    EXPECT_EQ(static_cast<int>(callbacks.all[1]->calls.size()),
              both.ours.num_residual_evaluations + both.ours.num_jacobian_evaluations + extra);
  }
}

INSTANTIATE_TEST_SUITE_P(Problems, EvaluationCallbacks,
                         ::testing::Values(CallbackCase{}, CallbackCase{true, 1e9},
                                           CallbackCase{true, 1.21}, CallbackCase{false, 1e9, true},
                                           CallbackCase{true, 1.21, true}),
                         [](const ::testing::TestParamInfo<CallbackCase>& instance) {
                           return std::string(instance.param.fixed_block ? "FixedBlock" : "Plain") +
                                  (instance.param.fail_beyond < 2.0 ? "FailingTrials" : "") +
                                  (instance.param.bounded ? "Bounded" : "");
                         });

TEST(EvaluationCallback, MemoryAfterATerminationAndAnAbort) {
  for (const auto with : {ceres::SOLVER_TERMINATE_SUCCESSFULLY, ceres::SOLVER_ABORT}) {
    for (const int at : {0, 1, 4}) {
      Callbacks callbacks;
      lambdas::Callback stop([at = at, with = with](const ceres::IterationSummary& summary) {
        return summary.iteration == at ? with : ceres::SOLVER_CONTINUE;
      });
      Options options = DenseQr();
      options.callbacks.push_back(&stop);
      const BothSolved both = SolveBoth(callbacks.Recipe({}), options);
      ExpectSameSummary(both, 1e-9, true);
      ExpectSameParameters(both, 1e-9);
      ExpectSameCalls(*callbacks.all[0], *callbacks.all[1]);
      if (with == ceres::SOLVER_ABORT) {
        EXPECT_EQ(both.our_problem->blocks[0][0], -1.2) << "to the last bit";
      }
    }
  }
}

TEST(EvaluationCallback, FailureAtTheStartPutsTheStartBack) {
  Callbacks callbacks;
  const BothSolved both = SolveBoth(callbacks.Recipe({true, 0.5}), DenseQr());
  EXPECT_EQ(both.ours.termination_type, ceres::FAILURE);
  ExpectSameSummary(both, 1e-9, true);
  ExpectSameCalls(*callbacks.all[0], *callbacks.all[1]);
  EXPECT_EQ(both.our_problem->blocks, both.stock_problem->blocks);
}

// A line whose PlusJacobian fails below a border, once that is drawn: it is called when it is set.
class LineAbove final : public manifolds::Manifold {
 public:
  LineAbove(double border, const bool* is_drawn) : border_(border), is_drawn_(*is_drawn) {}
  int AmbientSize() const override { return 1; }
  int TangentSize() const override { return 1; }
  bool Plus(const double* x, const double* delta, double* sum) const override {
    *sum = *x + *delta;
    return true;
  }
  bool PlusJacobian(const double* x, double* jacobian) const override {
    *jacobian = 1.0;
    return !is_drawn_ || *x >= border_;
  }
  bool Minus(const double*, const double*, double*) const override { return false; }
  bool MinusJacobian(const double*, double*) const override { return false; }

 private:
  const double border_;
  const bool& is_drawn_;
};

// With bounds those of the line search, too.
TEST(EvaluationCallback, IsNotToldOfAPointWherePlusJacobianFails) {
  for (const bool bounded : {false, true}) {
    for (const double border : {0.5, 10.0}) {  // at a trial point, and at the start
      std::vector<std::unique_ptr<SharedWork>> callbacks;
      bool is_drawn = false;
      const auto recipe = [&] {
        SharedWork* work = callbacks.emplace_back(std::make_unique<SharedWork>()).get();
        ceres::Problem::Options options;
        options.evaluation_callback = work;
        auto test = std::make_unique<TestProblem>(options);
        work->test = test.get();
        double* x = test->Add({5.0});
        test->Add({1.0});  // which the callback reads
        test->problem.AddResidualBlock(new testing::TargetCost({0.0}), nullptr, x);
        manifolds::Set(&test->problem, x, new LineAbove(border, &is_drawn));
        if (bounded) {
          test->problem.SetParameterLowerBound(x, 0, -5.0);
        }
        is_drawn = callbacks.size() == 2;  // both problems are there
        return test;
      };
      Options options = DenseQr();
      options.max_num_iterations = 3;
      const BothSolved both = SolveBoth(recipe, options);
      ExpectSameSummary(both, 1e-9, true);
      ExpectSameCalls(*callbacks[0], *callbacks[1]);
      ExpectSameParameters(both, 1e-9);
      EXPECT_EQ(both.ours.termination_type == ceres::FAILURE, border == 10.0);
    }
  }
}

// Ceres shows it from 2.2 on. Before, who does not tell has cost functions that were never
// prepared.
TEST(EvaluationCallback, NotTold) {
  Callbacks callbacks;
  const auto test = callbacks.Recipe({})();
  ceres::Solver::Summary summary;
  SolveReport report;
  Solve(DenseQr(), &test->problem, &summary, {}, &report);
  EXPECT_FALSE(report.used_stock) << report.fallback_reason;
  EXPECT_EQ(callbacks.all[0]->calls.empty(), CERES_VERSION_MINOR < 2);
  EXPECT_EQ(summary.initial_cost < 100.0, CERES_VERSION_MINOR >= 2);
}

TEST(EvaluationCallback, IncrementalModeAndSessionsSolveExactly) {
  for (const bool session : {false, true}) {
    Callbacks callbacks;
    const auto test = callbacks.Recipe({})();
    SolveOptions asked;
    SolveReport report;
    asked.mode = SolveMode::kIncremental;
    asked.evaluation_callback = test->evaluation_callback;
    Options options;
    ceres::Solver::Summary summary;
    testing::SolveBySessionOrOnce(session, options, &test->problem, asked, &summary, &report);
    EXPECT_FALSE(report.used_stock) << report.fallback_reason;
    EXPECT_EQ(report.exact_reason, "an evaluation callback, which is told of whole points only");
    EXPECT_GT(callbacks.all[0]->calls.size(), 2u);
    EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE);
  }
}

}  // namespace
}  // namespace inceres
