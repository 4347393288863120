// How and when cost functions are called, and what happens when they fail; stock Ceres is the
// oracle.
#include <cmath>
#include <thread>

#include <gtest/gtest.h>

#include "adapters/compare_with_stock.h"

namespace inceres {
namespace {

using testing::BothSolved;
using testing::MakeWindow;
using testing::SolveBoth;
using testing::TargetCost;
using testing::TestProblem;
using Options = ceres::Solver::Options;

// Calls a user's cost function saw, in order.
struct Calls {
  int num_cost_only = 0;
  int num_jacobian = 0;
};

// Values are the Jacobian's where it is asked for, but for the last kind.
enum class Misbehavior { kReturnsFalse, kNaN, kInfinity, k1e302, kUnwritten, kUnwrittenResidual };

// A quadratic with one block that misbehaves in the given cost-only call or the given call with
// Jacobians (counted from 1; 0: never).
testing::Recipe Misbehaving(Misbehavior kind, int bad_cost_only, int bad_jacobian) {
  return [=] {
    auto test = std::make_unique<TestProblem>();
    const auto evaluate = [=, target = std::make_shared<TargetCost>(std::vector{1.0, 2.0, 3.0}),
                           calls = Calls()](double const* const* x, double* residuals,
                                            double** jacobians) mutable {
      const bool bad = jacobians == nullptr ? ++calls.num_cost_only == bad_cost_only
                                            : ++calls.num_jacobian == bad_jacobian;
      const bool is_residual = jacobians == nullptr || kind == Misbehavior::kUnwrittenResidual;
      double* const victim = is_residual ? &residuals[1] : &jacobians[0][1];
      const double unwritten = *victim;
      target->Evaluate(x, residuals, jacobians);
      if (!bad || kind == Misbehavior::kReturnsFalse) {
        return !bad;
      }
      *victim = kind == Misbehavior::kNaN        ? std::nan("")
                : kind == Misbehavior::kInfinity ? INFINITY
                : kind == Misbehavior::k1e302    ? 1e302
                                                 : unwritten;
      return true;
    };
    test->problem.AddResidualBlock(new lambdas::Cost(3, {3}, evaluate), nullptr,
                                   test->Add({5.0, -4.0, 3.5}));
    return test;
  };
}

Options Tight() {
  Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  options.function_tolerance = 0.0;
  options.max_num_iterations = 10;
  return options;
}

constexpr const char* kStartFailed = CERES_VERSION_MINOR >= 2
                                         ? "Initial residual and Jacobian evaluation failed."
                                         : "Residual and Jacobian evaluation failed.";

class Misbehaviors : public ::testing::TestWithParam<Misbehavior> {};

TEST_P(Misbehaviors, AtTheStart) {
  const BothSolved both = SolveBoth(Misbehaving(GetParam(), 0, 1), Tight());
  ExpectSameSummary(both, 1e-9, true);
  EXPECT_EQ(both.ours.termination_type, ceres::FAILURE);
  EXPECT_EQ(both.ours.message, kStartFailed);
  EXPECT_EQ(both.ours.initial_cost, -1.0);
  EXPECT_EQ(both.our_problem->blocks, Misbehaving(GetParam(), 0, 0)()->blocks);
}

TEST_P(Misbehaviors, AtATrialPoint) {
  const BothSolved both = SolveBoth(Misbehaving(GetParam(), 2, 0), Tight());
  ExpectSameSummary(both, 1e-9, true);
  EXPECT_EQ(both.ours.num_unsuccessful_steps, 1)
      << "a step that cannot be evaluated is rejected, no more";
  EXPECT_EQ(both.ours.iterations[2].cost, both.stock.iterations[2].cost);
  EXPECT_TRUE(both.ours.IsSolutionUsable());
  ExpectSameParameters(both, 1e-9);
}

TEST_P(Misbehaviors, AtTheJacobianOfAnAcceptedPoint) {
  const BothSolved both = SolveBoth(Misbehaving(GetParam(), 0, 3), Tight());
  ExpectSameSummary(both, 1e-9, true);
  EXPECT_EQ(both.ours.termination_type, ceres::FAILURE);
  EXPECT_EQ(both.our_problem->blocks, Misbehaving(GetParam(), 0, 0)()->blocks)
      << "all progress is discarded";
}

INSTANTIATE_TEST_SUITE_P(All, Misbehaviors,
                         ::testing::Values(Misbehavior::kReturnsFalse, Misbehavior::kNaN,
                                           Misbehavior::kInfinity, Misbehavior::k1e302,
                                           Misbehavior::kUnwritten,
                                           Misbehavior::kUnwrittenResidual));

TEST(Evaluation, FixedResidualThatFails) {
  const auto recipe = [] {
    auto test = Misbehaving(Misbehavior::kReturnsFalse, 0, 0)();
    double* constant = test->Add({1.0, 2.0});
    auto fails = [](double const* const*, double*, double**) { return false; };
    test->problem.AddResidualBlock(new TargetCost({0.0, 0.0}), nullptr, constant);
    test->problem.AddResidualBlock(new TargetCost({0.0, 0.0}, fails), nullptr, constant);
    test->problem.SetParameterBlockConstant(constant);
    return test;
  };
  const BothSolved both = SolveBoth(recipe, Tight());
  ExpectSameSummary(both, 1e-9, true);
  EXPECT_EQ(both.ours.message, both.stock.message);
  EXPECT_EQ(both.ours.message,
            "Evaluation of the residual 2 failed during removal of fixed residual blocks.");
  EXPECT_EQ(both.our_problem->blocks, recipe()->blocks);
}

// A map of constants, under losses in part, and one block that a few residual blocks connect with
// it: what each cost function is called for, and the fixed cost to the last bit, are stock's.
TEST(Evaluation, MostlyConstantProblem) {
  constexpr int kNumConstants = 40;
  const auto recipe = [](std::vector<Calls>* calls) {
    auto test = std::make_unique<TestProblem>();
    std::vector<double*> blocks;
    for (int b = 0; b <= kNumConstants; ++b) {
      blocks.push_back(test->Add({0.3 * b, std::sin(3.0 * b)}));
    }
    calls->resize(4 * kNumConstants);  // stays where it is
    for (std::size_t r = 0; r < calls->size(); ++r) {
      Calls* const seen = &(*calls)[r];
      const auto hook = [seen](double const* const*, double*, double** jacobians) {
        ++(jacobians == nullptr ? seen->num_cost_only : seen->num_jacobian);
        return true;
      };
      const std::size_t b = r % 13 == 5 ? kNumConstants : r * 7 % kNumConstants;
      ceres::LossFunction* const loss = r % 3 == 0 ? new ceres::CauchyLoss(0.7) : nullptr;
      test->problem.AddResidualBlock(new TargetCost({0.1 * static_cast<double>(r), 0.7}, hook),
                                     loss, blocks[b]);
    }
    for (int b = 0; b < kNumConstants; ++b) {
      test->problem.SetParameterBlockConstant(blocks[static_cast<std::size_t>(b)]);
    }
    return test;
  };
  std::vector<Calls> by_stock, by_us;
  int copy = 0;
  const BothSolved both =
      SolveBoth([&] { return recipe(copy++ == 0 ? &by_stock : &by_us); }, Tight());
  ExpectSameSummary(both, 1e-9, true);
  EXPECT_EQ(both.ours.fixed_cost, both.stock.fixed_cost);
  EXPECT_EQ(both.ours.num_residual_blocks_reduced, 12);
  EXPECT_EQ(both.ours.num_parameter_blocks_reduced, 1);
  ASSERT_EQ(by_us.size(), by_stock.size());
  for (std::size_t r = 0; r < by_us.size(); ++r) {
    EXPECT_EQ(by_us[r].num_cost_only, by_stock[r].num_cost_only) << r;
    EXPECT_EQ(by_us[r].num_jacobian, by_stock[r].num_jacobian) << r;
    if (r % 13 != 5) {
      EXPECT_EQ(by_us[r].num_cost_only, 1) << r;
    }
  }
}

// A wrapper may hand the array on in another order to what it wraps: it is given a fresh one for
// each residual block.
TEST(Evaluation, TheArrayOfJacobiansIsTheCostFunctionsToChange) {
  const auto recipe = [] {
    auto test = std::make_unique<TestProblem>();
    double* x = test->Add({1.0});
    double* y = test->Add({2.0});
    for (const double target : {4.0, 5.0, 7.0}) {
      const auto exchanging = [target](double const* const* v, double* r, double** jacobians) {
        r[0] = 3.0 * v[0][0] + v[0][0] * v[1][0] - target;
        if (jacobians != nullptr) {
          jacobians[0][0] = 3.0 + v[1][0];
          std::swap(jacobians[0], jacobians[1]);
          jacobians[0][0] = v[0][0];
        }
        return true;
      };
      test->problem.AddResidualBlock(new lambdas::Cost(1, {1, 1}, exchanging), nullptr, x, y);
    }
    return test;
  };
  const BothSolved both = SolveBoth(recipe, Tight());
  ExpectSameSummary(both, 1e-9, true);
  ExpectSameParameters(both, 1e-9);
}

// Pointers a cost function is given.
TEST(Evaluation, ConstantsGetNullJacobiansAndTheUsersMemory) {
  int num_calls = 0;
  {
    TestProblem test;
    double* x = test.Add({3.0});
    double* c = test.Add({2.0});
    const auto pair = [&, x, c](double const* const* parameters, double* residuals, double** J) {
      ++num_calls;
      EXPECT_NE(parameters[0], x) << "variables are the solver's own copies";
      EXPECT_EQ(parameters[1], c);
      residuals[0] = parameters[0][0] * parameters[1][0] - 1.0;
      if (J != nullptr) {
        EXPECT_NE(J[0], nullptr);
        EXPECT_EQ(J[1], nullptr);
        J[0][0] = parameters[1][0];
      }
      return true;
    };
    test.problem.AddResidualBlock(new lambdas::Cost(1, {1, 1}, pair), nullptr, x, c);
    test.problem.SetParameterBlockConstant(c);
    ceres::Solver::Summary summary;
    inceres::Solve(Options(), &test.problem, &summary);
    EXPECT_EQ(num_calls, summary.num_residual_evaluations + summary.num_jacobian_evaluations);
    EXPECT_NEAR(x[0], 0.5, 1e-6);
    EXPECT_EQ(c[0], 2.0);
    num_calls = 0;
  }
  EXPECT_EQ(num_calls, 0) << "nothing is evaluated once Solve has returned";
}

TEST(Evaluation, OneThreadMeansTheCallersThread) {
  const auto test = MakeWindow(5, 40, true);
  const std::thread::id caller = std::this_thread::get_id();
  int num_elsewhere = 0;
  for (int k = 0; k < 200; ++k) {
    auto hook = [&](auto...) {
      num_elsewhere += std::this_thread::get_id() == caller ? 0 : 1;
      return true;
    };
    test->problem.AddResidualBlock(new TargetCost(std::vector<double>(9, 0.0), hook), nullptr,
                                   test->blocks[1].data());
  }
  Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  ceres::Solver::Summary summary;
  inceres::Solve(options, &test->problem, &summary);
  EXPECT_TRUE(summary.IsSolutionUsable()) << summary.message;
  EXPECT_EQ(num_elsewhere, 0);
}

// The value of one entry at each call: Ceres's sequence of points and of kinds of calls, call by
// call.
TEST(Evaluation, CallsComeInCeressOrder) {
  std::vector<std::pair<bool, double>> calls[2];
  int which = 0;
  const auto recipe = [&] {
    auto test = testing::MakeCurveFit(0.0);
    auto hook = [&calls, k = which++](double const* const* parameters, double*,
                                      double** jacobians) {
      calls[k].emplace_back(jacobians != nullptr, parameters[0][0]);
      return true;
    };
    test->problem.AddResidualBlock(new TargetCost({0.1}, hook), nullptr, test->blocks[0].data());
    return test;
  };
  const BothSolved both = SolveBoth(recipe, Tight());
  ASSERT_EQ(calls[0].size(), calls[1].size());
  for (std::size_t k = 0; k < calls[0].size(); ++k) {
    EXPECT_EQ(calls[0][k].first, calls[1][k].first) << "call " << k;
    EXPECT_NEAR(calls[0][k].second, calls[1][k].second, 1e-8) << "call " << k;
  }
}

TEST(Evaluation, ExceptionsLeaveTheUsersMemoryAlone) {
  auto test = std::make_unique<TestProblem>();
  int num_calls = 0;
  auto hook = [&](double const* const*, double*, double**) -> bool {
    if (++num_calls == 4) {
      throw std::runtime_error("from the cost function");
    }
    return true;
  };
  double* x = test->Add({5.0, 4.0});
  test->problem.AddResidualBlock(new TargetCost({1.0, 2.0}, hook), nullptr, x);
  ceres::Solver::Summary summary;
  EXPECT_THROW(inceres::Solve(Tight(), &test->problem, &summary), std::runtime_error);
  EXPECT_EQ(test->blocks[0], (std::vector<double>{5.0, 4.0}));
}

}  // namespace
}  // namespace inceres
