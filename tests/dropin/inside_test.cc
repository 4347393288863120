// The drop-in from inside a program that knows only Ceres, and asks it by its C functions what it
// has seen. Linked both with the shared Ceres and with a static one, and run in exact, incremental
// and auto mode.
#include <atomic>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <ceres/ceres.h>
#include <gtest/gtest.h>

#include "dropin/plain_problems.h"
#include "inceres/ceres/dropin.h"
#include "support/ceres_manifolds.h"

namespace {

// Whether a Problem that is solved again, and has not changed, is remembered.
bool Remembers() {
  const char* mode = std::getenv("INCERES_MODE");
  return mode != nullptr && (std::string(mode) == "incremental" || std::string(mode) == "auto");
}

// x² − target, which tells how often it was called.
class Square : public ceres::SizedCostFunction<1, 1> {
 public:
  explicit Square(double square) : target(square) {}
  bool Evaluate(const double* const* x, double* residuals, double** jacobians) const override {
    if (inside) {
      inside();
    }
    residuals[0] = x[0][0] * x[0][0] - target;
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      ++num_jacobians;
      jacobians[0][0] = 2.0 * x[0][0];
    }
    return true;
  }
  double target;
  std::function<void()> inside;
  mutable std::atomic<int> num_jacobians{0};
};

ceres::Solver::Summary Solve(ceres::Problem* problem) {
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
  options.function_tolerance = 1e-14;
  ceres::Solver::Summary summary;
  ceres::Solve(options, problem, &summary);
  return summary;
}

TEST(DropinInside, IsActive) {
  EXPECT_EQ(inceres_dropin_is_active(), 1);
}

TEST(DropinInside, AnEntryDiesWithItsProblem) {
  const int before = inceres_dropin_num_problems();
  {
    ceres::Problem one;
    ceres::Problem::Options options;
    const auto two = std::make_unique<ceres::Problem>(options);
    EXPECT_EQ(inceres_dropin_num_problems(), before + 2);
    ceres::Problem three(std::move(one));
    EXPECT_EQ(inceres_dropin_num_problems(), before + 2);
    *two = std::move(three);
    EXPECT_EQ(inceres_dropin_num_problems(), before + 1);
    one = ceres::Problem();
    EXPECT_EQ(inceres_dropin_num_problems(), before + 2);
  }
  EXPECT_EQ(inceres_dropin_num_problems(), before);
}

// A Problem that is solved again finds its Jacobians, also after it has moved; one that its caller
// removed and added again does not, though nothing about it can be told apart from before.
TEST(DropinInside, ALivingProblemIsRemembered) {
  double x = 3.0;
  ceres::Problem::Options options;
  options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  Square cost(2.5);
  Square other(0.5);  // so that no residual is zero at the end
  ceres::Problem problem(options);
  ceres::ResidualBlockId id = problem.AddResidualBlock(&cost, nullptr, &x);
  problem.AddResidualBlock(&other, nullptr, &x);
  Solve(&problem);
  Solve(&problem);
  Solve(&problem);  // begins to remember, in auto mode too
  const int first = cost.num_jacobians;
  Solve(&problem);
  EXPECT_GT(first, 1);
  if (!Remembers()) {
    EXPECT_GT(cost.num_jacobians, first);  // exact mode remembers nothing
    return;
  }
  EXPECT_EQ(cost.num_jacobians, first);

  ceres::Problem moved(std::move(problem));
  Solve(&moved);
  EXPECT_EQ(cost.num_jacobians, first);

  moved.RemoveResidualBlock(id);
  moved.AddResidualBlock(&cost, nullptr, &x);
  Solve(&moved);
  EXPECT_GT(cost.num_jacobians, first);
}

// Whoever's solve it ends: where stock goes first, to be compared with, ours has not been asked by
// then.
TEST(DropinInside, AnExceptionLosesNoEdit) {
  double x = 3.0;
  bool throws = false;
  ceres::Problem::Options options;
  options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  Square cost(2.0);
  cost.inside = [&throws] {
    if (throws) {
      throw std::runtime_error("no more");
    }
  };
  Square others[2] = {Square(4.0), Square(8.0)};
  ceres::Problem problem(options);
  problem.AddResidualBlock(&cost, nullptr, &x);
  ceres::ResidualBlockId id = problem.AddResidualBlock(&others[0], nullptr, &x);
  for (int k = 0; k < 3; ++k) {
    Solve(&problem);
  }
  for (int round = 1; round < 8; ++round) {
    const int other = round % 2;
    problem.RemoveResidualBlock(id);
    id = problem.AddResidualBlock(&others[other], nullptr, &x);
    throws = true;
    EXPECT_THROW(Solve(&problem), std::runtime_error);
    throws = false;
    Solve(&problem);
    EXPECT_NEAR(x * x, 0.5 * (cost.target + others[other].target), 1e-5) << round;
  }
}

// Nobody looks for bounds where none was ever set: each way to set one is seen, before the first
// solve and after it, and where the Problem has moved.
TEST(DropinInside, BoundsAreSeenWhenTheyAreSet) {
  double x = 3.0;
  ceres::Problem::Options options;
  options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  Square cost(2.5);
  ceres::Problem problem(options);
  problem.AddResidualBlock(&cost, nullptr, &x);
  Solve(&problem);
  EXPECT_NEAR(x, std::sqrt(2.5), 1e-6);
  problem.SetParameterLowerBound(&x, 0, 2.0);
  x = 3.0;
  Solve(&problem);
  EXPECT_EQ(x, 2.0);
  ceres::Problem moved(std::move(problem));
  x = 3.0;
  Solve(&moved);
  EXPECT_EQ(x, 2.0);

  ceres::Problem other(options);
  other.AddResidualBlock(&cost, nullptr, &x);
  other.SetParameterUpperBound(&x, 0, 1.5);
  x = 1.0;
  Solve(&other);
  EXPECT_EQ(x, 1.5);

  // of a constant, which stock refuses in its words
  double y = 1.0;
  other.AddParameterBlock(&y, 1);
  other.SetParameterBlockConstant(&y);
  other.SetParameterLowerBound(&y, 0, 2.0);
  EXPECT_EQ(Solve(&other).termination_type, ceres::FAILURE);
}

// Changed where it stands: no call of the Problem's tells.
TEST(DropinInside, ACostFunctionThatChangesInPlaceIsNoticed) {
  double x = 3.0;
  ceres::Problem::Options options;
  options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  Square cost(2.0);
  ceres::Problem problem(options);
  problem.AddResidualBlock(&cost, nullptr, &x);
  for (const double target : {2.0, 2.0, 2.0, 5.0, 3.0}) {
    cost.target = target;
    Solve(&problem);
    EXPECT_NEAR(x, std::sqrt(target), 1e-6);
  }
}

// Each call that edits a living Problem takes effect at the next solve. Whatever edits, it does so
// when the session, if there is one, knows the problem and would not look again.
TEST(DropinInside, EveryEditIsSeen) {
  ceres::Problem::Options options;
  manifolds::Borrow(&options);
  ceres::Problem problem(options);
  double x[2] = {3.0, 3.0};
  double y = 1.0;
  manifolds::SubsetManifold second_held(2, {1});
  // x₀ x₁ − 6 and small pulls toward (2, 3), so that there is one minimum, and it is not zero.
  struct Product {
    bool operator()(const double* const v, double* r) const {
      r[0] = v[0] * v[1] - 6.0;
      r[1] = 0.1 * (v[0] - 2.1);
      r[2] = 0.1 * (v[1] - 3.0);
      return true;
    }
  };
  problem.AddResidualBlock(
      new ceres::NumericDiffCostFunction<Product, ceres::CENTRAL, 3, 2>(new Product), nullptr, x);
  const auto settle = [&](double start) {
    const ceres::Solver::Summary summary = Solve(&problem);
    EXPECT_TRUE(summary.IsSolutionUsable()) << summary.message;
    x[0] = x[1] = start;
    return Solve(&problem).IsSolutionUsable();
  };
  for (int k = 0; k < 3; ++k) {
    EXPECT_TRUE(settle(3.0));
    EXPECT_NEAR(x[0] * x[1], 6.0, 0.05);
  }
  problem.SetParameterBlockConstant(x);
  EXPECT_TRUE(settle(3.5));
  EXPECT_EQ(x[0], 3.5);
  problem.SetParameterBlockVariable(x);
  EXPECT_TRUE(settle(3.0));
  EXPECT_NEAR(x[0] * x[1], 6.0, 0.05);
  manifolds::Set(&problem, x, &second_held);
  EXPECT_TRUE(settle(4.0));
  EXPECT_EQ(x[1], 4.0);
  EXPECT_NEAR(x[0], 1.5, 0.05);
  manifolds::Set(&problem, x, nullptr);
  EXPECT_TRUE(settle(3.0));
  EXPECT_NE(x[1], 3.0);
  problem.SetParameterUpperBound(x, 0, 1.0);
  EXPECT_TRUE(settle(0.5));
  EXPECT_LE(x[0], 1.0);
  problem.SetParameterUpperBound(x, 0, std::numeric_limits<double>::max());
  EXPECT_TRUE(settle(3.0));
  EXPECT_GT(x[0], 1.0);
  const ceres::ResidualBlockId other = problem.AddResidualBlock(new Square(4.0), nullptr, &y);
  EXPECT_TRUE(settle(3.0));
  EXPECT_NEAR(y, 2.0, 1e-6);
  problem.RemoveResidualBlock(other);
  y = 1.0;
  EXPECT_TRUE(settle(3.0));
  EXPECT_EQ(y, 1.0);
  problem.AddResidualBlock(new Square(9.0), nullptr, &y);
  EXPECT_TRUE(settle(3.0));
  EXPECT_NEAR(y, 3.0, 1e-6);
  problem.RemoveParameterBlock(&y);
  y = std::numeric_limits<double>::quiet_NaN();  // nobody's any more
  EXPECT_TRUE(settle(3.0));
  x[0] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(Solve(&problem).termination_type, ceres::FAILURE);
  EXPECT_TRUE(std::isnan(x[0]));
  x[0] = 3.0;
  EXPECT_TRUE(settle(3.0));
}

// A Problem at the address of another, with the other's arrays.
TEST(DropinInside, AnAddressServesAnotherProblem) {
  double x = 3.0;
  const auto memory =
      std::make_unique<std::aligned_storage_t<sizeof(ceres::Problem), alignof(ceres::Problem)>>();
  for (const double target : {2.0, 7.0, 11.0}) {
    auto* problem = new (memory.get()) ceres::Problem;
    problem->AddResidualBlock(new Square(target), nullptr, &x);
    for (int k = 0; k < 3; ++k) {
      Solve(problem);
      EXPECT_NEAR(x, std::sqrt(target), 1e-6);
    }
    problem->~Problem();
  }
}

TEST(DropinInside, ASolveInsideACostFunction) {
  const long long before = inceres_dropin_num_solves();
  double inner_x = 3.0;
  ceres::Problem inner;
  inner.AddResidualBlock(new Square(7.0), nullptr, &inner_x);
  double x = 3.0;
  ceres::Problem problem;
  auto* cost = new Square(2.0);
  cost->inside = [&] {
    inner_x = 3.0;
    Solve(&inner);
    EXPECT_NEAR(inner_x, std::sqrt(7.0), 1e-6);
  };
  problem.AddResidualBlock(cost, nullptr, &x);
  for (int k = 0; k < 3; ++k) {
    EXPECT_TRUE(Solve(&problem).IsSolutionUsable());
    EXPECT_NEAR(x, std::sqrt(2.0), 1e-6);
  }
  EXPECT_GT(inceres_dropin_num_solves(), before + 6);
}

// Odd, but nothing of ours may break: the session is in use while its own Problem is solved again.
TEST(DropinInside, ASolveInsideACostFunctionOfTheSameProblem) {
  double x = 3.0;
  ceres::Problem problem;
  auto* cost = new Square(2.0);
  bool nested = false;
  cost->inside = [&] {
    if (!nested) {
      nested = true;
      ceres::Solver::Options options;
      options.max_num_iterations = 0;
      ceres::Solver::Summary summary;
      ceres::Solve(options, &problem, &summary);
    }
  };
  problem.AddResidualBlock(cost, nullptr, &x);
  for (int k = 0; k < 4; ++k) {
    nested = false;
    x = 3.0;
    EXPECT_TRUE(Solve(&problem).IsSolutionUsable());
    EXPECT_NEAR(x, std::sqrt(2.0), 1e-6);
  }
}

// Threads that make, edit, solve, move and end Problems of their own, all at once; each gets what
// it would get alone.
TEST(DropinInside, ConcurrentProblems) {
  const auto run = [] {
    std::vector<double> results;
    for (int k = 0; k < 3; ++k) {
      ceres::Problem problem;
      plain::Chain chain;
      for (int frame = 0; frame < 9; ++frame) {
        chain.Grow(&problem);
        ceres::Solver::Summary summary;
        ceres::Solve(plain::ChainOptions(), &problem, &summary);
        results.push_back(summary.final_cost);
      }
      ceres::Problem moved(std::move(problem));
      ceres::Solver::Summary summary;
      ceres::Solve(plain::ChainOptions(), &moved, &summary);
      const std::vector<double> values = chain.Values();
      results.insert(results.end(), values.begin(), values.end());
    }
    return results;
  };
  const int before = inceres_dropin_num_problems();
  const std::vector<double> alone = run();
  std::vector<std::vector<double>> together(4);
  std::vector<std::thread> threads;
  for (auto& results : together) {
    threads.emplace_back([&results, &run] { results = run(); });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  for (const auto& results : together) {
    EXPECT_EQ(results, alone);
  }
  EXPECT_EQ(inceres_dropin_num_problems(), before);
}

}  // namespace
