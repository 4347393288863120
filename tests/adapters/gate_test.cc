// Everything that goes to stock Ceres: the reason, stock's result, and that a strict caller gets an
// error with nothing touched.
#include "adapters/ceres/fallback/gate.h"

#include <algorithm>
#include <cstring>
#include <deque>
#include <limits>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "adapters/captured_log.h"
#include "adapters/compare_with_stock.h"
#include "support/ceres_manifolds.h"

namespace inceres {
namespace {

using testing::Adjust;
using testing::CapturedLog;
using testing::MakeBundle;
using testing::ShapeOnlyCost;
using testing::TargetCost;
using testing::TestProblem;
using testing::WithoutAddresses;
using Options = ceres::Solver::Options;
using Blocks = std::deque<std::vector<double>>;

// The lines that tell of a fallback.
std::vector<std::string> Fallbacks(const CapturedLog& log) {
  std::vector<std::string> lines = log.messages();
  const auto tells = [](const std::string& line) {
    return line.rfind("inceres: handed to stock Ceres: ", 0) == 0;
  };
  lines.erase(std::stable_partition(lines.begin(), lines.end(), tells), lines.end());
  return lines;
}

std::unique_ptr<TestProblem> MakeProblem() {
  return MakeBundle(3, 20, true);
}

// NaN is the same as NaN.
void ExpectSameValues(const Blocks& a, const Blocks& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    ASSERT_EQ(a[i].size(), b[i].size());
    EXPECT_EQ(std::memcmp(a[i].data(), b[i].data(), a[i].size() * sizeof(double)), 0) << i;
  }
}

void ExpectStrictRefuses(const Adjust& adjust, const std::string& reason) {
  const auto test = MakeProblem();
  Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  adjust(test.get(), &options);
  int num_calls = 0;
  test->problem.AddResidualBlock(new TargetCost({1.0}, [&](auto...) { return ++num_calls > 0; }),
                                 nullptr, test->Add({0.0}));
  if (options.linear_solver_ordering != nullptr &&
      options.linear_solver_ordering->NumElements() > 0) {
    options.linear_solver_ordering->AddElementToGroup(test->blocks.back().data(), 1);
  }
  const auto before = test->blocks;
  ceres::Solver::Summary summary;
  SolveOptions asked;
  SolveReport report;
  asked.strict = true;
  const CapturedLog log(google::GLOG_INFO);
  inceres::Solve(options, &test->problem, &summary, asked, &report);
  EXPECT_EQ(summary.termination_type, ceres::FAILURE);
  EXPECT_NE(summary.message.find(reason), std::string::npos) << summary.message;
  EXPECT_NE(report.fallback_reason.find(reason), std::string::npos) << report.fallback_reason;
  EXPECT_FALSE(report.used_stock);
  EXPECT_EQ(summary.initial_cost, -1.0);
  EXPECT_TRUE(summary.iterations.empty());
  EXPECT_EQ(num_calls, 0);
  EXPECT_TRUE(Fallbacks(log).empty());
  ExpectSameValues(test->blocks, before);
}

// As stock: to the bits of memory, with its message, of which `words` are part, and its log.
void ExpectStockSolves(const Adjust& adjust, const std::string& reason, const std::string& words) {
  Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  const auto stock_problem = MakeProblem();
  const auto our_problem = MakeProblem();
  Options stock_options = options;
  Options our_options = options;
  adjust(stock_problem.get(), &stock_options);
  adjust(our_problem.get(), &our_options);
  ceres::Solver::Summary stock, ours;
  std::vector<std::string> logged;
  {
    const CapturedLog log(google::GLOG_INFO);
    ceres::Solve(stock_options, &stock_problem->problem, &stock);
    logged = log.messages();
  }
  SolveReport report;
  const CapturedLog log(google::GLOG_INFO);
  inceres::Solve(our_options, &our_problem->problem, &ours, {}, &report);
  EXPECT_TRUE(report.used_stock);
  EXPECT_NE(report.fallback_reason.find(reason), std::string::npos) << report.fallback_reason;
  const std::vector<std::string> lines = Fallbacks(log);
  ASSERT_EQ(lines.size(), 1u);
  EXPECT_NE(lines[0].find(reason), std::string::npos) << lines[0];
  EXPECT_EQ(log.messages().size(), logged.size() + 1);
  EXPECT_EQ(ours.termination_type, stock.termination_type);
  EXPECT_EQ(WithoutAddresses(ours.message), WithoutAddresses(stock.message));
  EXPECT_NE(ours.message.find(words), std::string::npos) << ours.message;
  EXPECT_EQ(ours.initial_cost, stock.initial_cost);
  EXPECT_EQ(ours.final_cost, stock.final_cost);
  EXPECT_EQ(ours.iterations.size(), stock.iterations.size());
  EXPECT_EQ(ours.num_residual_evaluations, stock.num_residual_evaluations);
  ExpectSameValues(our_problem->blocks, stock_problem->blocks);
}

void ExpectHandedOver(const Adjust& adjust, const std::string& reason, const std::string& words) {
  ExpectStrictRefuses(adjust, reason);
  ExpectStockSolves(adjust, reason, words);
}

// Options.

TEST(Gate, InvalidOptions) {
  ExpectHandedOver([](TestProblem*, Options* o) { o->max_num_iterations = -1; },
                   "the options are invalid: ", "max_num_iterations >= 0");
}

TEST(Gate, LineSearch) {
  ExpectHandedOver([](TestProblem*, Options* o) { o->minimizer_type = ceres::LINE_SEARCH; },
                   "LINE_SEARCH", "");
}

// Stock Ceres aborts on these two, so only the strict way can be looked at.
TEST(Gate, WhatStockAbortsOn) {
  ExpectStrictRefuses([](TestProblem*, Options* o) { o->min_lm_diagonal = 0.0; },
                      "min_lm_diagonal");
  const auto empty_ordering = [](TestProblem*, Options* o) {
    o->linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  };
  ExpectStrictRefuses(empty_ordering, "linear_solver_ordering is empty");
}

TEST(Gate, PreconditionersThatTheLinearSolverDoesNotHave) {
  const auto with = [](ceres::LinearSolverType solver, ceres::PreconditionerType preconditioner) {
    return [=](TestProblem* test, Options* o) {
      o->linear_solver_type = solver;
      o->preconditioner_type = preconditioner;
      std::vector<ceres::ResidualBlockId> blocks;
      test->problem.GetResidualBlocks(&blocks);
      o->residual_blocks_for_subset_preconditioner = {blocks.begin(), blocks.end()};
    };
  };
  ExpectStrictRefuses(with(ceres::CGNR, ceres::SCHUR_JACOBI),
                      "preconditioner_type SCHUR_JACOBI with CGNR");
  ExpectStrictRefuses(with(ceres::ITERATIVE_SCHUR, ceres::SUBSET),
                      "preconditioner_type SUBSET with ITERATIVE_SCHUR");
}

// Problems.

TEST(Gate, FeasibleBoundsOnAConstantBlockAreNoObstacle) {
  const auto test = MakeProblem();
  test->problem.SetParameterLowerBound(test->blocks[0].data(), 0, -1e3);
  ceres::Solver::Summary summary;
  SolveReport report;
  inceres::Solve(Options(), &test->problem, &summary, {}, &report);
  EXPECT_FALSE(report.used_stock) << report.fallback_reason;
}

// Of a block in use, and of one that nothing touches. Equal bounds are infeasible too.
TEST(Gate, LowerBoundNotBelowTheUpper) {
  for (const bool used : {true, false}) {
    for (const double upper : {1.0, 2.0}) {
      const auto adjust = [=](TestProblem* t, Options*) {
        double* const block = used ? t->blocks[5].data() : t->Add({0.0, 0.0, 0.0});
        t->problem.AddParameterBlock(block, 3);
        t->problem.SetParameterLowerBound(block, 1, 2.0);
        t->problem.SetParameterUpperBound(block, 1, upper);
      };
      ExpectHandedOver(
          adjust, "lower bound not below its upper bound",
          "has at least one infeasible bound.\nFirst infeasible bound is at index: 1.");
    }
  }
}

TEST(Gate, ConstantOutsideItsBounds) {
  ExpectHandedOver([](TestProblem* t,
                      Options*) { t->problem.SetParameterLowerBound(t->blocks[0].data(), 0, 1e3); },
                   "constant outside its bounds",
                   "has at least one infeasible value.\nFirst infeasible value is at index: 0.");
}

// Constant blocks and those that nothing touches are looked at too.
TEST(Gate, ValueThatIsNotFinite) {
  for (const double bad :
       {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(), 1e302}) {
    for (const int block : {0, 5, -1}) {
      const auto adjust = [=](TestProblem* t, Options*) {
        if (block < 0) {
          t->problem.AddParameterBlock(t->Add({1.0, bad}), 2);
        } else {
          t->blocks[static_cast<std::size_t>(block)][1] = bad;
        }
      };
      ExpectHandedOver(adjust, "not finite",
                       "has at least one invalid value.\nFirst invalid value is at index: 1.");
    }
  }
}

// To Ceres it is constant.
TEST(Gate, BlockOfSizeZero) {
  ExpectHandedOver(
      [](TestProblem* t, Options* o) {
        o->linear_solver_type = ceres::DENSE_QR;
        auto* pull = new lambdas::Formula(
            1, {1, 0}, [](double const* const* x, double* residuals, double** jacobians) {
              residuals[0] = x[0][0];
              jacobians[0][0] = 1.0;
              return true;
            });
        t->problem.AddResidualBlock(pull, nullptr, t->Add({5.0}), t->Add({0.0}));
      },
      "of size 0 has no values", "");
}

// x ⊞ δ = x + δ, in two dimensions. Notes when it is asked for more than sizes.
class WatchedSum final : public manifolds::Manifold {
 public:
  explicit WatchedSum(int* num_calls) : num_calls_(*num_calls) {}
  int AmbientSize() const override { return 2; }
  int TangentSize() const override { return 2; }
  bool Plus(const double* x, const double* delta, double* sum) const override {
    ++num_calls_;
    std::transform(x, x + 2, delta, sum, std::plus<>());
    return true;
  }
  bool PlusJacobian(const double*, double* jacobian) const override {
    ++num_calls_;
    std::fill_n(jacobian, 4, 0.0);
    jacobian[0] = jacobian[3] = 1.0;
    return true;
  }
  bool Minus(const double*, const double*, double*) const override { return false; }
  bool MinusJacobian(const double*, double*) const override { return false; }

 private:
  int& num_calls_;
};

// What bounds need in incremental mode is seen by what the manifold does.
TEST(Gate, ManifoldsAreNotAskedWhereAProblemGoesToStock) {
  for (const bool session : {false, true}) {
    int num_calls = 0;
    TestProblem test;
    double* x = test.Add({1.0, 2.0});
    test.problem.AddResidualBlock(new TargetCost({0.0, 0.0}), nullptr, x);
    manifolds::Set(&test.problem, x, new WatchedSum(&num_calls));
    test.problem.SetParameterLowerBound(x, 0, 2.0);
    test.problem.SetParameterUpperBound(x, 0, 1.0);
    num_calls = 0;
    ceres::Solver::Summary summary;
    SolveOptions asked;
    SolveReport report;
    asked.mode = SolveMode::kIncremental;
    asked.strict = true;
    testing::SolveBySessionOrOnce(session, Options(), &test.problem, asked, &summary, &report);
    EXPECT_NE(report.fallback_reason.find("lower bound not below"), std::string::npos)
        << report.fallback_reason;
    EXPECT_EQ(num_calls, 0);
  }
}

// Orderings. Points in the first group and cameras in the second, but for what is changed.

Adjust WithOrdering(const std::function<void(TestProblem*, ceres::ParameterBlockOrdering*)>& change,
                    ceres::LinearSolverType type = ceres::DENSE_SCHUR) {
  return [=](TestProblem* t, Options* o) {
    o->linear_solver_type = type;
    o->linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    for (std::vector<double>& block : t->blocks) {
      o->linear_solver_ordering->AddElementToGroup(block.data(), block.size() == 3 ? 0 : 1);
    }
    change(t, o->linear_solver_ordering.get());
  };
}

TEST(Gate, OrderingWithAForeignAddressInPlaceOfABlock) {
  static double foreign = 0.0;
  ExpectHandedOver(WithOrdering([](TestProblem* t, ceres::ParameterBlockOrdering* ordering) {
                     ordering->Remove(t->blocks.back().data());
                     ordering->AddElementToGroup(&foreign, 0);
                   }),
                   "no parameter block of the problem",
                   "is not a parameter block in the problem. The invalid double is in group: 0");
}

TEST(Gate, OrderingThatLacksABlock) {
  const auto remove = [](TestProblem* t, ceres::ParameterBlockOrdering* ordering) {
    ordering->Remove(t->blocks.back().data());
  };
  for (const auto type : {ceres::DENSE_SCHUR, ceres::SPARSE_SCHUR, ceres::ITERATIVE_SCHUR,
                          ceres::SPARSE_NORMAL_CHOLESKY}) {
    ExpectHandedOver(WithOrdering(remove, type), "variable parameter blocks",
                     "The program has 22 parameter blocks, but the parameter block ordering has 21 "
                     "parameter blocks.");
  }
}

// Where there is nothing to eliminate, but a factor to order.
TEST(Gate, OrderingOfASubsetThatLacksABlock) {
  const auto adjust = WithOrdering(
      [](TestProblem* t, ceres::ParameterBlockOrdering* ordering) {
        ordering->Remove(t->blocks.back().data());
      },
      ceres::CGNR);
  ExpectHandedOver(
      [=](TestProblem* t, Options* o) {
        adjust(t, o);
        o->preconditioner_type = ceres::SUBSET;
        std::vector<ceres::ResidualBlockId> blocks;
        t->problem.GetResidualBlocks(&blocks);
        o->residual_blocks_for_subset_preconditioner = {blocks.begin(), blocks.end()};
      },
      "variable parameter blocks",
      "The program has 22 parameter blocks, but the parameter block ordering has 21");
}

TEST(Gate, FirstGroupThatIsNotIndependent) {
  ExpectHandedOver(WithOrdering([](TestProblem* t, ceres::ParameterBlockOrdering* ordering) {
                     ordering->AddElementToGroup(t->blocks[1].data(), 0);
                   }),
                   "not an independent set",
                   "The first elimination group in the parameter block ordering of size 21 is not "
                   "an independent set");
}

// An ordering is not looked at where Ceres does not look at it.
TEST(Gate, OddOrderingUnderADenseSolverIsNoObstacle) {
  for (const auto type : {ceres::DENSE_QR, ceres::DENSE_NORMAL_CHOLESKY}) {
    const auto test = MakeProblem();
    Options options;
    options.linear_solver_type = type;
    options.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    options.linear_solver_ordering->AddElementToGroup(test->blocks[1].data(), 0);
    ceres::Solver::Summary summary;
    SolveReport report;
    inceres::Solve(options, &test->problem, &summary, {}, &report);
    EXPECT_FALSE(report.used_stock) << report.fallback_reason;
    EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE);
  }
}

TEST(Gate, OrderingThatLacksABlockUnderDynamicSparsityIsNoObstacle) {
  const auto remove = [](TestProblem* t, ceres::ParameterBlockOrdering* ordering) {
    ordering->Remove(t->blocks.back().data());
  };
  Options options;
  options.dynamic_sparsity = true;
  options.max_num_iterations = 3;
  const testing::BothSolved both =
      testing::SolveBoth(MakeProblem, options, WithOrdering(remove, ceres::SPARSE_NORMAL_CHOLESKY));
  testing::ExpectSameSummary(both, 1e-6, /*same_elimination=*/true);
  EXPECT_EQ(both.report.options_without_effect, std::vector<std::string>{"linear_solver_ordering"});
}

std::string ReasonFor(const Options& options, ceres::Problem* problem) {
  return internal::FindObstacle(options, /*incremental=*/false, nullptr, *problem);
}

TEST(Gate, DenseQrForWhichThereIsNoMemory) {
  for (const int num_residuals : {3000, 30000}) {
    TestProblem test;
    double* x = test.Add(std::vector<double>(500, 1.0));
    test.problem.AddResidualBlock(new ShapeOnlyCost(num_residuals, {500}), nullptr, x);
    Options options;
    options.linear_solver_type = ceres::DENSE_QR;
    EXPECT_EQ(ReasonFor(options, &test.problem), "");
    const internal::ProblemView view = internal::Introspect(test.problem);
    const std::string reason = internal::DenseQrObstacle(options, view, internal::OrderingView(),
                                                         [] { return 200.0 * 1024 * 1024; });
    EXPECT_EQ(reason.find("memory: DENSE_QR of 30500 x 500") == 0, num_residuals == 30000)
        << reason;
    options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
    EXPECT_EQ(
        internal::DenseQrObstacle(options, view, internal::OrderingView(), [] { return 0.0; }), "");
  }
}

// Five million entries with the damping rows, which were stock's once.
TEST(Gate, ALargeDenseQrIsSolvedHere) {
  const auto recipe = [] { return MakeBundle(10, 240, true); };
  Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  options.max_num_iterations = 1;
  const testing::BothSolved both = testing::SolveBoth(recipe, options);
  EXPECT_FALSE(both.report.used_stock) << both.report.fallback_reason;
  testing::ExpectSameSummary(both, 1e-6, /*same_elimination=*/true);
}

TEST(Gate, BlockTwiceAndOverlappingBlocks) {
  ceres::Problem::Options unsafe;
  unsafe.disable_all_safety_checks = true;
  std::vector<double> memory(8, 1.0);
  ceres::Problem twice(unsafe);
  twice.AddResidualBlock(new ShapeOnlyCost(1, {2, 2}), nullptr, memory.data(), memory.data());
  EXPECT_NE(ReasonFor(Options(), &twice).find("twice"), std::string::npos);
  ceres::Problem overlap(unsafe);
  overlap.AddResidualBlock(new ShapeOnlyCost(1, {4, 4}), nullptr, memory.data(), memory.data() + 2);
  EXPECT_NE(ReasonFor(Options(), &overlap).find("overlaps"), std::string::npos);
}

// Modes.

// As one that turns out to be too large once it is known that it is to be solved exactly.
TEST(Gate, WhatIsDeclinedWasNotSolvedExactly) {
  const auto test = MakeProblem();
  const Options options;
  ceres::Solver::Summary summary;
  SolveOptions asked;
  SolveReport report;
  asked.strict = true;
  report.exact_reason = "linear_solver_type DENSE_QR";
  internal::Decline({options, &test->problem, &summary, asked, &report}, "memory");
  EXPECT_EQ(report.fallback_reason, "memory");
  EXPECT_EQ(report.exact_reason, "");
}

TEST(Gate, StockOnRequestIsNoFallback) {
  const auto test = MakeProblem();
  ceres::Solver::Summary summary;
  SolveOptions asked;
  SolveReport report;
  asked.mode = SolveMode::kStock;
  asked.strict = true;
  const CapturedLog log(google::GLOG_INFO);
  inceres::Solve(Options(), &test->problem, &summary, asked, &report);
  EXPECT_TRUE(report.used_stock);
  EXPECT_TRUE(Fallbacks(log).empty());
  EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE);
}

TEST(Gate, WithoutAReportStockStillSolvesAndTheLogSaysSo) {
  const auto test = MakeProblem();
  Options options;
  options.minimizer_type = ceres::LINE_SEARCH;
  ceres::Solver::Summary summary;
  const CapturedLog log(google::GLOG_INFO);
  inceres::Solve(options, &test->problem, &summary);
  EXPECT_EQ(Fallbacks(log).size(), 1u);
  EXPECT_EQ(summary.minimizer_type, ceres::LINE_SEARCH);
}

TEST(Gate, NullArgumentsDieAsInCeres) {
  ceres::Problem problem;
  ceres::Solver::Summary summary;
  EXPECT_DEATH(inceres::Solve(Options(), nullptr, &summary), "problem");
  EXPECT_DEATH(inceres::Solve(Options(), &problem, nullptr), "summary");
}

}  // namespace
}  // namespace inceres
