// The choice by predicted cost, and that solvers which stood aside catch up.
#include "linear/automatic_solver.h"

#include <string>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "linear/growing_system.h"
#include "support/dense_oracle.h"

namespace inceres::internal {
namespace {

class AutomaticSolverTest : public testing::Test {
 protected:
  void Update(GrowingSystem* system, const ReducedSolver::Rows& change, int first_b) {
    const std::vector<double> weights(system->b.size(), 1.0);
    ASSERT_TRUE(system->Factorize(change, &solver_).ok());
    ASSERT_TRUE(system->Solve({first_b}, {weights.data(), 1e-22}, &solver_).ok());
    const Eigen::VectorXd expected = system->Dense().llt().solve(system->FreeB());
    EXPECT_LE(test::RelativeError(system->X(), expected), 1e-8);
  }

  Executor executor_{1};
  AutomaticSolver solver_{executor_};
};

TEST_F(AutomaticSolverTest, APathIsResumed) {
  GrowingSystem system(1);
  for (int i = 0; i < 200; ++i) {
    system.AddRow(6, 3, false);
  }
  Update(&system, {}, 0);
  EXPECT_STREQ(solver_.Name(), "resumed Cholesky");
}

TEST_F(AutomaticSolverTest, AFullMatrixIsResumed) {
  GrowingSystem system(1);
  for (int i = 0; i < 100; ++i) {
    system.AddRow(6, 100, false);
  }
  Update(&system, {}, 0);
  EXPECT_STREQ(solver_.Name(), "resumed Cholesky");
  system.Perturb(99);
  Update(&system, {99, nullptr}, 100);
  EXPECT_EQ(solver_.work().factored_rows, 1);
}

// A way there and back: it fills the envelope, but not the factor in a better order.
GrowingSystem ThereAndBack(int count, int band) {
  GrowingSystem system(1);
  for (int i = 0; i < count; ++i) {
    system.AddRow(6, band, false);
    for (int far = count - i; far > count - i - band && far >= 0 && far < i; --far) {
      system.Couple(i, far);
    }
  }
  return system;
}

TEST_F(AutomaticSolverTest, AnAgedOrderIsRenewed) {
  GrowingSystem system = ThereAndBack(300, 1);
  Update(&system, {}, 0);
  EXPECT_STREQ(solver_.Name(), "resumed Cholesky");
  EXPECT_EQ(solver_.work().reorderings, 1);
}

// Arms from one place, one frame of each in turn: an envelope holds them all side by side in any
// order that begins at one end.
GrowingSystem Arms(int count, int length, int band) {
  GrowingSystem system(1);
  for (int i = 0; i < count * length; ++i) {
    system.AddRow(15, 0, false);
    for (int step = 1; step <= band && i >= step * count; ++step) {
      system.Couple(i, i - step * count);
    }
    if (i > 0 && i < count) {
      system.Couple(i, 0);
    }
  }
  return system;
}

TEST_F(AutomaticSolverTest, ArmsAreATree) {
  GrowingSystem system = Arms(12, 10, 2);
  Update(&system, {}, 0);
  EXPECT_STREQ(solver_.Name(), "Bayes tree");
}

// All changes: the tree. Then the newest row changes, again and again: the resumed factor, once
// catching up is worth it.
TEST_F(AutomaticSolverTest, SolversTakeTurns) {
  GrowingSystem system = Arms(5, 8, 4);
  const int newest = system.num_rows() - 1;
  int turns = 0;
  std::string last;
  for (int step = 0; step < 120; ++step) {
    const int row = step % 40 == 0 ? 0 : newest;
    system.Perturb(row);
    const int first_b = step % 3 == 0 ? 10 : newest;
    system.b[static_cast<std::size_t>(system.OffsetOf(first_b))] += system.random.Unit();
    Update(&system, {row, nullptr}, first_b);
    turns += last != solver_.Name();
    last = solver_.Name();
  }
  EXPECT_GE(turns, 3);
  EXPECT_GT(solver_.Bytes(), 0u);
}

}  // namespace
}  // namespace inceres::internal
