// Ceres's inner iterations next to stock Ceres: traces, orderings, summaries, what is refused.
#include <cmath>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "adapters/ceres/plan/inner_ordering.h"
#include "adapters/ceres/plan/structure_cache.h"
#include "adapters/ceres/read/introspection.h"
#include "adapters/compare_with_stock.h"
#include "adapters/test_problems.h"

namespace inceres {
namespace {

using testing::BothSolved;
using testing::MediumBundle;
using testing::MediumWindow;
using testing::TestProblem;

ceres::Solver::Options WithInnerIterations(ceres::LinearSolverType type) {
  ceres::Solver::Options options;
  options.linear_solver_type = type;
  options.use_inner_iterations = true;
  options.max_num_iterations = 8;
  return options;
}

void ExpectStocks(const BothSolved& both, double tolerance) {
  EXPECT_FALSE(both.report.used_stock) << both.report.fallback_reason;
  testing::ExpectSameSummary(both, tolerance, /*same_elimination=*/true);
  EXPECT_TRUE(both.ours.inner_iterations_used);
  EXPECT_EQ(both.ours.inner_iterations_used, both.stock.inner_iterations_used);
  EXPECT_EQ(both.ours.num_inner_iteration_steps, both.stock.num_inner_iteration_steps);
  EXPECT_EQ(both.ours.inner_iteration_ordering_used, both.stock.inner_iteration_ordering_used);
  EXPECT_EQ(both.ours.inner_iteration_ordering_given, both.stock.inner_iteration_ordering_given);
  EXPECT_GT(both.ours.inner_iteration_time_in_seconds, 0.0);
}

// The points only.
void GivePoints(TestProblem* test, ceres::Solver::Options* options) {
  options->inner_iteration_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (std::vector<double>& block : test->blocks) {
    if (block.size() == 3) {
      options->inner_iteration_ordering->AddElementToGroup(block.data(), 0);
    }
  }
}

// Inverse depths together, then pose and velocity blocks one by one.
void GiveAll(TestProblem* test, ceres::Solver::Options* options) {
  options->inner_iteration_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  int group = 0;
  for (std::vector<double>& block : test->blocks) {
    options->inner_iteration_ordering->AddElementToGroup(block.data(),
                                                         block.size() == 1 ? 0 : ++group);
  }
}

TEST(InnerIterations, TraceIsStocksWithTheOrderingThatIsChosen) {
  for (const ceres::LinearSolverType type :
       {ceres::DENSE_SCHUR, ceres::SPARSE_SCHUR, ceres::SPARSE_NORMAL_CHOLESKY, ceres::DENSE_QR}) {
    const BothSolved both = testing::SolveBoth(MediumBundle, WithInnerIterations(type));
    ExpectStocks(both, 1e-6);
    testing::ExpectSameParameters(both, 1e-5);
    EXPECT_EQ(both.ours.inner_iteration_ordering_used.size(), 2U);
    EXPECT_GE(both.ours.num_inner_iteration_steps, 0);
  }
}

TEST(InnerIterations, TraceIsStocksWithGivenPointsOnly) {
  const BothSolved both =
      testing::SolveBoth(MediumBundle, WithInnerIterations(ceres::DENSE_SCHUR), GivePoints);
  ExpectStocks(both, 1e-6);
  testing::ExpectSameParameters(both, 1e-5);
}

TEST(InnerIterations, TraceIsStocksInAWindowWithManifoldsLossesAndConstants) {
  for (const ceres::LinearSolverType type : {ceres::DENSE_SCHUR, ceres::SPARSE_NORMAL_CHOLESKY}) {
    const BothSolved both = testing::SolveBoth(MediumWindow, WithInnerIterations(type), GiveAll);
    EXPECT_FALSE(both.report.used_stock) << both.report.fallback_reason;
    testing::ExpectSameSummary(both, 1e-6, /*same_elimination=*/false);
    EXPECT_EQ(both.ours.num_inner_iteration_steps, both.stock.num_inner_iteration_steps);
    EXPECT_GT(both.ours.inner_iteration_ordering_used.size(), 8U);
  }
}

TEST(InnerIterations, TraceIsStocksWithDoglegNonmonotonicStepsAndAnyTolerance) {
  ceres::Solver::Options options = WithInnerIterations(ceres::DENSE_SCHUR);
  options.trust_region_strategy_type = ceres::DOGLEG;
  ExpectStocks(testing::SolveBoth(MediumBundle, options), 1e-5);
  options = WithInnerIterations(ceres::DENSE_SCHUR);
  options.use_nonmonotonic_steps = true;
  ExpectStocks(testing::SolveBoth(MediumBundle, options), 1e-6);
  options = WithInnerIterations(ceres::DENSE_SCHUR);
  options.inner_iteration_tolerance = 0.9;  // one round, then no more
  const BothSolved both = testing::SolveBoth(MediumBundle, options);
  ExpectStocks(both, 1e-6);
  EXPECT_LT(both.ours.num_inner_iteration_steps + 2, static_cast<int>(both.ours.iterations.size()));
}

TEST(InnerIterations, TraceIsStocksWithBounds) {
  const auto bounded = [] {
    auto test = MediumBundle();
    for (std::vector<double>& block : test->blocks) {
      if (block.size() == 3) {
        test->problem.SetParameterLowerBound(block.data(), 2, block[2] - 0.005);
        test->problem.SetParameterUpperBound(block.data(), 0, block[0] + 0.002);
      }
    }
    return test;
  };
  const BothSolved both = testing::SolveBoth(bounded, WithInnerIterations(ceres::DENSE_SCHUR));
  ExpectStocks(both, 1e-5);
}

TEST(InnerIterations, SameBitsForAnyNumberOfThreads) {
  std::vector<double> ends[3];
  for (int threads = 1; threads <= 3; ++threads) {
    ceres::Solver::Options options = WithInnerIterations(ceres::DENSE_SCHUR);
    options.num_threads = threads;
    const auto test = MediumBundle();
    ceres::Solver::Summary summary;
    inceres::Solve(options, &test->problem, &summary);
    for (const std::vector<double>& block : test->blocks) {
      ends[threads - 1].insert(ends[threads - 1].end(), block.begin(), block.end());
    }
  }
  EXPECT_EQ(ends[0], ends[1]);
  EXPECT_EQ(ends[0], ends[2]);
}

// e^a b − y of two blocks; counts calls.
struct CallCounts {
  int costs = 0;
  int jacobians = 0;
};

ceres::CostFunction* ScaledExponential(double y, CallCounts* calls) {
  return new lambdas::Cost(1, {1, 1},
                           [=](double const* const* x, double* residuals, double** jacobians) {
                             ++(jacobians == nullptr ? calls->costs : calls->jacobians);
                             const double scale = std::exp(x[0][0]);
                             residuals[0] = scale * x[1][0] - y;
                             if (jacobians != nullptr && jacobians[0] != nullptr) {
                               jacobians[0][0] = scale * x[1][0];
                             }
                             if (jacobians != nullptr && jacobians[1] != nullptr) {
                               jacobians[1][0] = scale;
                             }
                             return true;
                           });
}

std::unique_ptr<TestProblem> Exponentials(double phase, CallCounts* calls) {
  auto test = std::make_unique<TestProblem>();
  std::vector<double*> scales, values;
  for (int k = 0; k < 12; ++k) {
    scales.push_back(test->Add({0.1 * k}));
    values.push_back(test->Add({1.0 + 0.3 * k}));
  }
  for (std::size_t i = 0; i < scales.size(); ++i) {
    for (std::size_t j = 0; j < values.size(); ++j) {
      const double y =
          2.0 + std::sin(phase + 7.0 * static_cast<double>(i) + 3.0 * static_cast<double>(j));
      test->problem.AddResidualBlock(ScaledExponential(y, calls), nullptr, scales[i], values[j]);
    }
  }
  test->problem.SetParameterBlockConstant(scales[0]);
  return test;
}

// Where a group has left its blocks the next one, and the next iteration, need no new Jacobians.
// Of a problem of the same structure before nothing is used.
TEST(InnerIterations, CallCostFunctionsLessOftenThanStock) {
  ceres::Solver::Options options = WithInnerIterations(ceres::DENSE_SCHUR);
  options.inner_iteration_tolerance = 1e-9;
  for (const double phase : {0.0, 1.0, 2.0}) {
    CallCounts calls[2];
    ceres::Solver::Summary stock, ours;
    ceres::Solve(options, &Exponentials(phase, &calls[0])->problem, &stock);
    SolveOptions strictly;
    strictly.strict = true;
    inceres::Solve(options, &Exponentials(phase, &calls[1])->problem, &ours, strictly);
    ASSERT_EQ(stock.iterations.size(), ours.iterations.size());
    for (std::size_t k = 0; k < stock.iterations.size(); ++k) {
      EXPECT_NEAR(ours.iterations[k].cost, stock.iterations[k].cost, 1e-9 * stock.initial_cost);
    }
    EXPECT_EQ(stock.num_inner_iteration_steps, ours.num_inner_iteration_steps);
    EXPECT_EQ(stock.num_jacobian_evaluations, ours.num_jacobian_evaluations);
    EXPECT_LE(calls[1].costs, calls[0].costs);
    EXPECT_LT(calls[1].jacobians, 0.9 * calls[0].jacobians);
  }
}

// Whatever a solver that is kept has room for.
TEST(InnerIterations, AskForJacobiansAsOftenAsStockWhereTheseAreChecked) {
  ceres::Solver::Options options = WithInnerIterations(ceres::DENSE_SCHUR);
  options.inner_iteration_tolerance = 1e-9;
  options.gradient_check_relative_precision = 1e-4;
  SolveOptions strictly;
  strictly.strict = true;
  CallCounts unchecked, calls[2];
  ceres::Solver::Summary stock, ours;
  inceres::Solve(options, &Exponentials(1.0, &unchecked)->problem, &ours, strictly);
  options.check_gradients = true;
  ceres::Solve(options, &Exponentials(1.0, &calls[0])->problem, &stock);
  inceres::Solve(options, &Exponentials(1.0, &calls[1])->problem, &ours, strictly);
  ASSERT_EQ(stock.iterations.size(), ours.iterations.size());
  for (std::size_t k = 0; k < stock.iterations.size(); ++k) {
    EXPECT_NEAR(ours.iterations[k].cost, stock.iterations[k].cost, 1e-9 * stock.initial_cost);
  }
  EXPECT_EQ(calls[1].jacobians, calls[0].jacobians);
  EXPECT_LT(unchecked.jacobians, calls[1].jacobians);
}

// To the bit; but cost functions are called more often.
TEST(InnerIterations, EndWhereTheyDoWithRoomToKeepEvaluations) {
  const auto solve = [](std::int64_t max_memory_bytes, CallCounts* calls) {
    internal::StructureCache::OfProcess().Clear();  // a solver that is kept has room already
    SolveOptions limited;
    limited.max_memory_bytes = max_memory_bytes;
    ceres::Solver::Summary summary;
    inceres::Solve(WithInnerIterations(ceres::DENSE_SCHUR), &Exponentials(0.0, calls)->problem,
                   &summary, limited);
    return summary;
  };
  CallCounts with_room, without;
  const ceres::Solver::Summary expected = solve(0, &with_room);
  ceres::Solver::Summary actual;
  // the least that is enough to solve
  for (std::int64_t bytes = 1024; actual.termination_type == ceres::FAILURE; bytes += bytes / 64) {
    ASSERT_LT(bytes, std::int64_t{1} << 30) << actual.message;
    without = CallCounts();
    actual = solve(bytes, &without);
  }
  EXPECT_EQ(expected.final_cost, actual.final_cost);
  EXPECT_EQ(expected.iterations.size(), actual.iterations.size());
  EXPECT_EQ(with_room.costs, without.costs);
  EXPECT_LT(with_room.jacobians, without.jacobians);
}

TEST(InnerIterations, MessageIsStocksForGroupsThatAreNotIndependent) {
  const BothSolved both = testing::SolveBoth(
      MediumBundle, WithInnerIterations(ceres::SPARSE_NORMAL_CHOLESKY),
      [](TestProblem* test, ceres::Solver::Options* options) {
        options->inner_iteration_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
        for (std::vector<double>& block : test->blocks) {
          options->inner_iteration_ordering->AddElementToGroup(block.data(), 7);
        }
      });
  EXPECT_FALSE(both.report.used_stock);
  EXPECT_EQ(both.ours.message, both.stock.message);
  EXPECT_NE(both.ours.message.find("Group Id: 7"), std::string::npos);
  testing::ExpectSameSummary(both, 0.0, /*same_elimination=*/true);
  EXPECT_EQ(both.ours.inner_iteration_ordering_used, both.stock.inner_iteration_ordering_used);
  EXPECT_FALSE(both.ours.inner_iterations_used);
}

TEST(InnerIterations, UnknownAddressesAndCallbacksAreRefusedWithAMessage) {
  const auto test = MediumBundle();
  double stranger = 0.0;
  ceres::Solver::Options options = WithInnerIterations(ceres::DENSE_SCHUR);
  options.inner_iteration_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  options.inner_iteration_ordering->AddElementToGroup(&stranger, 3);
  ceres::Solver::Summary summary;
  inceres::Solve(options, &test->problem, &summary);
  EXPECT_EQ(summary.termination_type, ceres::FAILURE);
  EXPECT_NE(summary.message.find("no parameter block of the problem. Group Id: 3"),
            std::string::npos);

  int count = 0;
  lambdas::Preparation callback([&](bool, bool) { ++count; });
  SolveOptions ours;
  ours.evaluation_callback = &callback;
  inceres::Solve(WithInnerIterations(ceres::DENSE_SCHUR), &test->problem, &summary, ours);
  EXPECT_EQ(summary.termination_type, ceres::FAILURE);
  EXPECT_EQ(summary.message, "Inner iterations cannot be used with EvaluationCallbacks");
  EXPECT_EQ(count, 0);
}

// Ceres refuses before it takes constants out of the ordering.
TEST(InnerIterations, TheOrderingStaysAsGivenWhereACallbackForbidsThem) {
  lambdas::Preparation callback([](bool, bool) {});
  ceres::Problem::Options with_callback;
  with_callback.evaluation_callback = &callback;
  const auto three = [&] {
    auto test = std::make_unique<TestProblem>(with_callback);
    for (int k = 0; k < 3; ++k) {
      test->problem.AddResidualBlock(new testing::TargetCost({1.0}), nullptr, test->Add({2.0}));
    }
    test->problem.SetParameterBlockConstant(test->blocks[1].data());
    return test;
  };
  const BothSolved both = testing::SolveBoth(
      three, WithInnerIterations(ceres::SPARSE_NORMAL_CHOLESKY),
      [](TestProblem* test, ceres::Solver::Options* options) {
        options->inner_iteration_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
        options->inner_iteration_ordering->AddElementToGroup(test->blocks[0].data(), 0);
        options->inner_iteration_ordering->AddElementToGroup(test->blocks[1].data(), 0);
        options->inner_iteration_ordering->AddElementToGroup(test->blocks[2].data(), 1);
      });
  EXPECT_EQ(both.ours.message, "Inner iterations cannot be used with EvaluationCallbacks");
  testing::ExpectSameSummary(both, 0.0, /*same_elimination=*/true);
  EXPECT_EQ(both.ours.inner_iteration_ordering_used, (std::vector<int>{2, 1}));
}

TEST(InnerIterations, NoneForOneBlockOrAnOrderingOfNothingThatMoves) {
  const auto curve = [] { return testing::MakeCurveFit(0.0); };
  const BothSolved one = testing::SolveBoth(
      [] {
        auto test = std::make_unique<TestProblem>();
        double* x = test->Add({1.0, 2.0});
        test->problem.AddResidualBlock(new testing::TargetCost({3.0, 4.0}), nullptr, x);
        return test;
      },
      WithInnerIterations(ceres::DENSE_QR));
  testing::ExpectSameSummary(one, 1e-9, /*same_elimination=*/true);
  EXPECT_FALSE(one.ours.inner_iterations_used);
  EXPECT_EQ(one.ours.num_inner_iteration_steps, one.stock.num_inner_iteration_steps);
  const BothSolved none = testing::SolveBoth(
      curve, WithInnerIterations(ceres::DENSE_QR),
      [](TestProblem* test, ceres::Solver::Options* options) {
        double* unused = test->Add({0.0});
        test->problem.AddParameterBlock(unused, 1);
        options->inner_iteration_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
        options->inner_iteration_ordering->AddElementToGroup(unused, 0);
      });
  testing::ExpectSameSummary(none, 1e-9, /*same_elimination=*/true);
  EXPECT_FALSE(none.ours.inner_iterations_used);
  EXPECT_EQ(none.ours.inner_iteration_ordering_used, none.stock.inner_iteration_ordering_used);
  EXPECT_EQ(none.ours.inner_iteration_ordering_given, none.stock.inner_iteration_ordering_given);
}

TEST(InnerIterations, EveryVariableBlockIsInOneGroupOfNoNeighbors) {
  const auto test = MediumWindow();
  const internal::ProblemView view = internal::Introspect(test->problem);
  const internal::InnerOrdering ordering =
      internal::FindInnerOrdering(ceres::Solver::Options(), nullptr, view);
  std::vector<int> group_of(view.blocks.size(), -1);
  int count = 0;
  for (std::size_t g = 0; g < ordering.groups.size(); ++g) {
    for (const int b : ordering.groups[g]) {
      EXPECT_EQ(group_of[static_cast<std::size_t>(b)], -1);
      group_of[static_cast<std::size_t>(b)] = static_cast<int>(g);
      ++count;
    }
  }
  EXPECT_EQ(count, view.reduced.num_parameter_blocks);
  for (const internal::ResidualBlockView& residual : view.residuals) {
    const int* slots = view.SlotsOf(residual);
    for (int s = 0; s < residual.num_slots; ++s) {
      for (int t = 0; t < s; ++t) {
        const int a = group_of[static_cast<std::size_t>(slots[s])];
        EXPECT_TRUE(a < 0 || a != group_of[static_cast<std::size_t>(slots[t])]);
      }
    }
  }
}

TEST(InnerIterations, ASolveInIncrementalModeIsExact) {
  const auto test = MediumBundle();
  ceres::Solver::Summary summary;
  SolveOptions ours;
  ours.mode = SolveMode::kIncremental;
  SolveReport report;
  inceres::Solve(WithInnerIterations(ceres::DENSE_SCHUR), &test->problem, &summary, ours, &report);
  EXPECT_FALSE(report.used_stock);
  EXPECT_NE(report.exact_reason.find("use_inner_iterations"), std::string::npos);
  EXPECT_TRUE(summary.inner_iterations_used);
}

}  // namespace
}  // namespace inceres
