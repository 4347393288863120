// Bounds in incremental mode and in sessions: values keep to them, whatever changes between two
// solves, and a solve ends at the optimum within them, where exact mode ends, or below.
#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "adapters/session_support.h"
#include "adapters/test_problems.h"

namespace inceres {
namespace {

using testing::Borrowing;
using testing::Session;

constexpr double kNone = std::numeric_limits<double>::max();

// What depends smoothly, and not linearly, on two blocks of three values.
class Bend : public lambdas::Formula {
 public:
  explicit Bend(double shift)
      : Formula(3, {3, 3}, [=](double const* const* x, double* residuals, double** jacobians) {
          for (int k = 0; k < 3; ++k) {
            const int next = (k + 1) % 3;
            const double a = x[0][k], b = x[1][next];
            const double slope = -0.3 * std::cos(a + b);
            residuals[k] = b - a - 0.3 * std::sin(a + b) - shift;
            jacobians[0][4 * k] = slope - 1.0;
            jacobians[1][3 * k + next] = slope + 1.0;
          }
          return true;
        }) {}
};

// Half of what it is asked to move: no value is bounded by what its step is bounded by.
class HalfSteps : public manifolds::Manifold {
 public:
  int AmbientSize() const override { return 3; }
  int TangentSize() const override { return 3; }
  bool Plus(const double* x, const double* delta, double* moved) const override {
    for (int k = 0; k < 3; ++k) {
      moved[k] = x[k] + 0.5 * delta[k];
    }
    return true;
  }
  bool PlusJacobian(const double* /*x*/, double* jacobian) const override {
    for (int k = 0; k < 9; ++k) {
      jacobian[k] = k % 4 == 0 ? 0.5 : 0.0;
    }
    return true;
  }
  bool Minus(const double* y, const double* x, double* delta) const override {
    for (int k = 0; k < 3; ++k) {
      delta[k] = 2.0 * (y[k] - x[k]);
    }
    return true;
  }
  bool MinusJacobian(const double* /*x*/, double* jacobian) const override {
    for (int k = 0; k < 9; ++k) {
      jacobian[k] = k % 4 == 0 ? 2.0 : 0.0;
    }
    return true;
  }
};

// A manifold of a user's that holds the middle value.
class WithoutTheMiddle : public manifolds::Manifold {
 public:
  int AmbientSize() const override { return 3; }
  int TangentSize() const override { return 2; }
  bool Plus(const double* x, const double* delta, double* moved) const override {
    const double result[3] = {x[0] + delta[0], x[1], x[2] + delta[1]};
    std::copy_n(result, 3, moved);
    return true;
  }
  bool PlusJacobian(const double* /*x*/, double* jacobian) const override {
    const double J[6] = {1.0, 0.0, 0.0, 0.0, 0.0, 1.0};
    std::copy_n(J, 6, jacobian);
    return true;
  }
  bool Minus(const double* y, const double* x, double* delta) const override {
    delta[0] = y[0] - x[0];
    delta[1] = y[2] - x[2];
    return true;
  }
  bool MinusJacobian(const double* /*x*/, double* jacobian) const override {
    const double J[6] = {1.0, 0.0, 0.0, 0.0, 0.0, 1.0};
    std::copy_n(J, 6, jacobian);
    return true;
  }
};

// A chain of blocks that lives on, and a copy of it as it is now, for exact mode.
class Chain {
 public:
  explicit Chain(unsigned seed) : random_(seed), problem_(Borrowing()) {
    for (int i = 0; i < 6; ++i) {
      Grow();
    }
    manifolds::Set(&problem_, blocks_[1].data(), &without_middle_);
    manifolds::Set(&problem_, blocks_[2].data(), &without_first_);
  }

  void Grow() {
    blocks_.push_back({Draw(), Draw(), Draw()});
    lower_.emplace_back(3, -kNone);
    upper_.emplace_back(3, kNone);
    pulls_.push_back(std::make_unique<testing::TargetCost>(
        std::vector<double>{2.0 * Draw(), 2.0 * Draw(), 2.0 * Draw()}));
    pull_ids_.push_back(problem_.AddResidualBlock(pulls_.back().get(), nullptr, Last()));
    if (blocks_.size() > 1) {
      bends_.push_back(std::make_unique<Bend>(Draw()));
      problem_.AddResidualBlock(bends_.back().get(), nullptr, blocks_[blocks_.size() - 2].data(),
                                Last());
    }
  }
  // One change of any kind.
  void Edit() {
    const std::size_t i = Any();
    switch (random_() % 6) {
      case 0:
        return Grow();
      case 1:
        return Bound(i, -kNone, kNone);
      case 2:
        pulls_.push_back(std::make_unique<testing::TargetCost>(
            std::vector<double>{2.0 * Draw(), 2.0 * Draw(), 2.0 * Draw()}));
        problem_.RemoveResidualBlock(pull_ids_[i]);
        pull_ids_[i] = problem_.AddResidualBlock(pulls_.back().get(), nullptr, blocks_[i].data());
        return;
      case 3:
        if (problem_.IsParameterBlockConstant(blocks_[i].data())) {
          return;
        }
        for (double& value : blocks_[i]) {
          value = Draw();  // outside its bounds, perhaps
        }
        return;
      case 4:
        if (problem_.IsParameterBlockConstant(blocks_[i].data())) {
          problem_.SetParameterBlockVariable(blocks_[i].data());
        } else if (IsWithin(i)) {
          problem_.SetParameterBlockConstant(blocks_[i].data());
        }
        return;
      default:
        return BoundNear(i);
    }
  }
  void BoundSome() {
    for (std::size_t i = 0; i < blocks_.size(); i += 2) {
      BoundNear(i);
      BoundNear(i + 1);
    }
  }
  void Bound(std::size_t i, double lower, double upper) {
    if (problem_.IsParameterBlockConstant(blocks_[i].data())) {
      return;
    }
    for (int k = 0; k < 3; ++k) {
      problem_.SetParameterLowerBound(blocks_[i].data(), k, lower);
      problem_.SetParameterUpperBound(blocks_[i].data(), k, upper);
    }
    std::fill_n(lower_[i].begin(), 3, lower);
    std::fill_n(upper_[i].begin(), 3, upper);
  }

  bool IsWithin(std::size_t i) const {
    for (std::size_t k = 0; k < 3; ++k) {
      if (blocks_[i][k] < lower_[i][k] || blocks_[i][k] > upper_[i][k]) {
        return false;
      }
    }
    return true;
  }
  bool AllWithin() const {
    for (std::size_t i = 0; i < blocks_.size(); ++i) {
      if (!IsWithin(i)) {
        return false;
      }
    }
    return true;
  }
  int NumAtBounds() const {
    int count = 0;
    for (std::size_t i = 0; i < blocks_.size(); ++i) {
      for (std::size_t k = 0; k < 3; ++k) {
        count += blocks_[i][k] == lower_[i][k] || blocks_[i][k] == upper_[i][k] ? 1 : 0;
      }
    }
    return count;
  }
  // Where exact mode ends from here; the values stay what they are.
  double ExactCost() {
    const std::deque<std::vector<double>> values = blocks_;
    ceres::Solver::Options options;
    options.logging_type = ceres::SILENT;
    options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
    options.function_tolerance = 1e-14;
    options.parameter_tolerance = 1e-14;
    options.max_num_iterations = 500;
    ceres::Solver::Summary summary;
    inceres::Solve(options, &problem_, &summary);
    EXPECT_TRUE(summary.IsSolutionUsable()) << summary.message;
    for (std::size_t i = 0; i < blocks_.size(); ++i) {
      std::copy(values[i].begin(), values[i].end(), blocks_[i].begin());
    }
    return summary.final_cost;
  }
  ceres::Problem* problem() { return &problem_; }
  std::deque<std::vector<double>>& blocks() { return blocks_; }

 private:
  double Draw() { return std::uniform_real_distribution<double>(-1.0, 1.0)(random_); }
  double* Last() { return blocks_.back().data(); }
  std::size_t Any() { return random_() % blocks_.size(); }
  void BoundNear(std::size_t i) {
    const double middle = 0.5 * Draw();
    const bool one_side = random_() % 3 == 0;
    Bound(i, one_side ? -kNone : middle - 0.3, middle + 0.3);
  }

  std::mt19937 random_;
  // Before the problem, which looks at them to its end.
  WithoutTheMiddle without_middle_;
  manifolds::SubsetManifold without_first_{3, {0}};
  std::vector<std::unique_ptr<testing::TargetCost>> pulls_;
  std::vector<std::unique_ptr<Bend>> bends_;
  ceres::Problem problem_;
  std::deque<std::vector<double>> blocks_;
  std::vector<std::vector<double>> lower_, upper_;
  std::vector<ceres::ResidualBlockId> pull_ids_;
};

TEST(SessionBounds, WhateverChangesASolveEndsAtTheOptimumWithinThem) {
  int most_at_bounds = 0, num_changed = 0, num_handed_over = 0;
  for (unsigned seed = 1; seed <= 8; ++seed) {
    Chain chain(seed);
    chain.BoundSome();
    Session session;
    for (int round = 0; round < 15; ++round) {
      session.Solve(chain.problem());
      SCOPED_TRACE("seed " + std::to_string(seed) + ", round " + std::to_string(round));
      ASSERT_EQ(session.summary.termination_type, ceres::CONVERGENCE) << session.summary.message;
      num_handed_over += session.report.exact_reason.empty() ? 0 : 1;
      ASSERT_TRUE(chain.AllWithin());
      // From there: bounds may cut a basin in two.
      ASSERT_LE(session.summary.final_cost, chain.ExactCost() * (1.0 + 1e-6) + 1e-12);
      most_at_bounds = std::max(most_at_bounds, chain.NumAtBounds());
      num_changed += session.changes().num_changed_bounds;
      chain.Edit();
      chain.Edit();
    }
  }
  EXPECT_LE(num_handed_over, 12) << "of 120: what takes more than 25 steps the batch solver ends";
  EXPECT_GT(most_at_bounds, 5);
  EXPECT_GT(num_changed, 20);
}

TEST(SessionBounds, WhatHasNotChangedIsKept) {
  Chain chain(3);
  chain.BoundSome();
  Session session;
  session.Solve(chain.problem());
  EXPECT_TRUE(session.summary.is_constrained);
  EXPECT_EQ(session.changes().num_changed_bounds, 0) << "all of it is new";
  session.Solve(chain.problem());
  EXPECT_EQ(session.changes().num_changed_bounds, 0);
  EXPECT_EQ(session.changes().num_removed_variables, 0);
  EXPECT_EQ(session.changes().num_replaced_factors, 0);
  chain.Bound(4, -0.01, 0.02);
  session.Solve(chain.problem());
  EXPECT_EQ(session.changes().num_changed_bounds, 1);
  EXPECT_EQ(session.changes().num_removed_variables, 0);
  EXPECT_TRUE(chain.AllWithin());
  chain.Bound(4, -kNone, kNone);
  session.Solve(chain.problem());
  EXPECT_EQ(session.changes().num_changed_bounds, 1) << "lifted";
}

// It was on the user's manifold in the graph, where bounds have no place.
TEST(SessionBounds, BoundsThatComeToABlockOnAManifold) {
  Chain chain(4);
  Session session;
  session.Solve(chain.problem());
  EXPECT_FALSE(session.summary.is_constrained);
  chain.Bound(1, -0.05, 0.05);
  chain.blocks()[1] = {0.0, 0.0, 0.0};
  session.Solve(chain.problem());
  EXPECT_EQ(session.changes().num_removed_variables, 1);
  EXPECT_TRUE(session.report.exact_reason.empty()) << session.report.exact_reason;
  EXPECT_TRUE(chain.AllWithin());
  EXPECT_LE(session.summary.final_cost, chain.ExactCost() * (1.0 + 1e-6));
}

TEST(SessionBounds, OneSolveInIncrementalMode) {
  for (unsigned seed = 21; seed <= 26; ++seed) {
    Chain chain(seed);
    chain.BoundSome();
    ceres::Solver::Options options;
    options.logging_type = ceres::SILENT;
    options.linear_solver_type = ceres::DENSE_SCHUR;
    options.function_tolerance = 1e-12;
    SolveOptions asked;
    asked.mode = SolveMode::kIncremental;
    asked.strict = true;
    SolveReport report;
    ceres::Solver::Summary summary;
    inceres::Solve(options, chain.problem(), &summary, asked, &report);
    EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE) << summary.message;
    EXPECT_TRUE(report.exact_reason.empty()) << report.exact_reason;
    EXPECT_TRUE(summary.is_constrained);
    EXPECT_TRUE(chain.AllWithin());
    EXPECT_GT(chain.NumAtBounds(), 0);
    EXPECT_LE(summary.final_cost, chain.ExactCost() * (1.0 + 1e-6)) << "seed " << seed;
  }
}

// A start outside is projected, and stays what it was if the solve fails.
TEST(SessionBounds, AStartOutsideThem) {
  testing::Pull pull(5.0, 1.0);
  double x = -7.0;
  ceres::Problem problem(Borrowing());
  problem.AddResidualBlock(&pull, nullptr, &x);
  problem.SetParameterLowerBound(&x, 0, 1.0);
  problem.SetParameterUpperBound(&x, 0, 3.0);
  Session session;
  pull.fails = true;
  session.Solve(&problem);
  EXPECT_EQ(session.summary.termination_type, ceres::FAILURE);
  EXPECT_EQ(x, -7.0);
  pull.fails = false;
  session.Solve(&problem);
  EXPECT_EQ(session.summary.termination_type, ceres::CONVERGENCE) << session.summary.message;
  EXPECT_EQ(session.summary.initial_cost, 8.0) << "of the start on its bound";
  EXPECT_EQ(x, 3.0);
}

TEST(SessionBounds, OnAManifoldThatStepsOtherwiseTheSolveIsExact) {
  HalfSteps half;
  testing::TargetCost pull({3.0, 3.0, 3.0});
  std::vector<double> x(3, 0.0);
  ceres::Problem problem(Borrowing());
  problem.AddResidualBlock(&pull, nullptr, x.data());
  manifolds::Set(&problem, x.data(), &half);
  problem.SetParameterUpperBound(x.data(), 1, 1.0);
  Session session;
  session.Solve(&problem);
  EXPECT_NE(session.report.exact_reason.find("bounds of values that steps do not move one by one"),
            std::string::npos)
      << session.report.exact_reason;
  EXPECT_NEAR(x[0], 3.0, 1e-3);
  EXPECT_EQ(x[1], 1.0);
}

// Steps up are allowed by it, and incremental mode has no use for them.
TEST(SessionBounds, NonmonotonicStepsAreAnOptionWithoutEffect) {
  Chain chain(5);
  ceres::Solver::Options options;
  options.use_nonmonotonic_steps = true;
  Session session;
  session.Solve(chain.problem(), options);
  EXPECT_TRUE(session.report.exact_reason.empty()) << session.report.exact_reason;
  const std::vector<std::string>& without = session.report.options_without_effect;
  EXPECT_EQ(std::count(without.begin(), without.end(), "use_nonmonotonic_steps"), 1);
  EXPECT_LE(session.summary.final_cost, chain.ExactCost() * (1.0 + 1e-6));
}

}  // namespace
}  // namespace inceres
