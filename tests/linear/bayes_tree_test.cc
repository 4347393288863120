// The Bayes tree: no work where none is due. (That it is right after any edits: GrowingSystemLaws.)
#include "linear/bayes_tree.h"

#include <cmath>
#include <memory>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "linear/growing_system.h"
#include "support/dense_oracle.h"
#include "support/suitesparse_memory.h"

namespace inceres::internal {
namespace {

constexpr ReducedSolver::Truncation kAllOfIt;

class BayesTreeTest : public testing::Test {
 protected:
  Status Update(GrowingSystem* system, const ReducedSolver::Rows& changed, int first_b,
                const ReducedSolver::Truncation& truncation = kAllOfIt) {
    const Status status = system->Factorize(changed, &tree_);
    return status.ok() ? system->Solve({first_b}, truncation, &tree_) : status;
  }
  static double ErrorOf(const GrowingSystem& system) {
    const Eigen::VectorXd expected = system.Dense().llt().solve(system.FreeB());
    return test::RelativeError(system.X(), expected);
  }

  Executor executor_{1};
  BayesTree tree_{executor_};
};

// Poses along a line, with loops from one to another.
GrowingSystem LoopyPath(int length, int size, int loop_every) {
  GrowingSystem system(1);
  for (int i = 0; i < length; ++i) {
    system.AddRow(size, 1, false);
    if (loop_every > 0 && i % loop_every == loop_every - 1) {
      system.Couple(i, (7919 * (i / loop_every)) % i);
    }
  }
  return system;
}

TEST_F(BayesTreeTest, BeforeAFactorizationThereIsNoGain) {
  const GrowingSystem system = LoopyPath(1, 3, 0);
  double gain = -1.0;
  EXPECT_FALSE(tree_.SolveForGain(system.b.data(), {}, &gain).ok());
  EXPECT_EQ(gain, -1.0);
}

TEST_F(BayesTreeTest, NothingChangedIsNothingDone) {
  GrowingSystem system = LoopyPath(200, 3, 5);
  ASSERT_TRUE(Update(&system, {}, 0).ok());
  EXPECT_EQ(tree_.work().factored_rows, 200);
  EXPECT_EQ(tree_.work().solved_rows, 200);
  const std::vector<double> before = system.x;
  // not even where it is said that all may have changed
  ASSERT_TRUE(Update(&system, {}, 200).ok());
  EXPECT_EQ(tree_.work().factored_rows, 0);
  EXPECT_EQ(tree_.work().forward_rows, 0);
  EXPECT_EQ(tree_.work().solved_rows, 0);
  EXPECT_EQ(system.x, before);
}

TEST_F(BayesTreeTest, ANewPoseTouchesTheTopOnly) {
  GrowingSystem system = LoopyPath(300, 3, 0);
  ASSERT_TRUE(Update(&system, {}, 0).ok());
  for (int k = 0; k < 20; ++k) {
    system.AddRow(3, 1, false);
    ASSERT_TRUE(Update(&system, {300 + k, nullptr}, 300 + k, {system.damping.data(), 1e-14}).ok());
  }
  EXPECT_LT(tree_.work().factored_rows, 40);
  EXPECT_LT(tree_.work().solved_rows, 60);
  EXPECT_LE(ErrorOf(system), 1e-6);
}

TEST_F(BayesTreeTest, AChangeReachesWhatIsAboveIt) {
  GrowingSystem system = LoopyPath(150, 3, 9);
  ASSERT_TRUE(Update(&system, {}, 0).ok());
  const double all = tree_.work().factor_flops;
  double sum = 0.0;
  int count = 0;
  for (int row = 0; row < 150; row += 7) {
    system.Perturb(row);
    const std::vector<int> rows{row};
    ASSERT_TRUE(Update(&system, {row, &rows}, 150).ok());
    sum += tree_.work().factor_flops;
    ++count;
    ASSERT_LE(ErrorOf(system), 1e-11) << row;
  }
  EXPECT_LT(sum, 0.8 * count * all);
  EXPECT_GT(sum, 0.0);
}

// An order that grew loop by loop is not much worse than one of all that is there.
TEST_F(BayesTreeTest, TheOrderStaysGood) {
  GrowingSystem system(7);
  for (int i = 0; i < 600; ++i) {
    system.AddRow(3, 1, false);
    std::vector<int> rows{i};
    if (i % 3 == 2) {
      system.Couple(i, (7919 * (i / 3)) % i);
    }
    const Status status = Update(&system, {i, &rows}, i);
    ASSERT_TRUE(status.ok()) << i << status.message;
  }
  BayesTree fresh(executor_);
  ASSERT_TRUE(system.Factorize({}, &fresh).ok());
  EXPECT_LE(tree_.tree().flops(), 2.0 * fresh.tree().flops());
  EXPECT_LE(ErrorOf(system), 1e-11);
}

TEST_F(BayesTreeTest, ARowThatComesBackMayHaveOtherNeighbors) {
  GrowingSystem system = LoopyPath(30, 3, 4);
  ASSERT_TRUE(Update(&system, {}, 0).ok());
  for (const int row : {29, 7, 12}) {
    system.S.RemoveRow(row);
    system.S.ReviveRow(row, 3);
    system.Perturb(row);
    system.Couple(row, row - 5);
    const std::vector<int> rows{row};
    ASSERT_TRUE(Update(&system, {row, &rows}, 0).ok());
    EXPECT_LE(ErrorOf(system), 1e-11) << row;
  }
}

// What goes and comes back between two factorizations may get the room of another block, in which
// the values it has now may be those that were factored. Its rows have the neighbors that they had.
TEST_F(BayesTreeTest, BlocksThatTradeTheirRoomsAreOthers) {
  GrowingSystem system(1);
  const auto set = [&](int row, int column, double value) {
    *system.S.values(system.S.FindOrAdd(row, column)) = value;
  };
  for (int i = 0; i < 5; ++i) {
    system.AddRow(1, 0, false);
    set(i, i, 9.0);
  }
  set(1, 0, 1.0);
  set(2, 0, 2.0);
  set(4, 4, 4.0);
  ASSERT_TRUE(Update(&system, {}, 0).ok());
  system.S.RemoveBlock(1, 0);
  system.S.RemoveBlock(2, 0);
  set(1, 0, 2.0);
  set(2, 0, 1.0);
  const std::vector<int> coupled{0, 1, 2};
  ASSERT_TRUE(Update(&system, {0, &coupled}, 5).ok());
  EXPECT_LE(ErrorOf(system), 1e-11);
  // Rows with all that they have, here the blocks on the diagonal.
  const std::int64_t room = system.S.Find(3, 3);
  for (const int row : {3, 4}) {
    system.S.RemoveRow(row);
  }
  for (const int row : {3, 4}) {
    system.S.ReviveRow(row, 1);
  }
  ASSERT_EQ(system.S.Find(4, 4), room);
  set(3, 3, 4.0);
  set(4, 4, 9.0);
  const std::vector<int> revived{3, 4};
  ASSERT_TRUE(Update(&system, {3, &revived}, 5).ok());
  EXPECT_LE(ErrorOf(system), 1e-11);
}

// A row that had come when memory ran out, and has gone again before the next try, is not waited
// for; and when it comes back it is as new as any.
TEST_F(BayesTreeTest, ARowThatGoesWhileNoMemoryIsThereIsForgotten) {
  test::SuiteSparseMemory memory;
  if (!memory.IsReachable()) {
    GTEST_SKIP() << "this SuiteSparse does not let its allocator be replaced";
  }
  GrowingSystem system = LoopyPath(30, 3, 4);
  ASSERT_TRUE(Update(&system, {}, 0).ok());
  system.AddRow(3, 2, false);
  memory.Deny();
  EXPECT_EQ(Update(&system, {30}, 0).code, StatusCode::kUnavailable);
  memory.Grant();
  const std::vector<int> rows{30};
  system.RemoveRow(30);
  ASSERT_TRUE(Update(&system, {30, &rows}, 0).ok());
  EXPECT_FALSE(tree_.tree().Has(30)) << "a clique of no size";
  EXPECT_LE(ErrorOf(system), 1e-11);
  // Back, with the same neighbors, of which nothing is told.
  system.S.ReviveRow(30, 3);
  system.Perturb(30);
  for (const int neighbor : {28, 29}) {
    system.Couple(30, neighbor);
  }
  for (std::vector<double>* vector : {&system.damping, &system.b, &system.x}) {
    vector->insert(vector->end(), 3, 1.0);
  }
  ASSERT_TRUE(Update(&system, {30, &rows}, 0).ok());
  EXPECT_LE(ErrorOf(system), 1e-11);
}

// Each step leaves out what is below the threshold; what is left out does not add up.
TEST_F(BayesTreeTest, TheErrorOfTruncationStaysBounded) {
  GrowingSystem system(11);
  system.diagonal_entry = 8.0;
  for (int i = 0; i < 80; ++i) {
    system.AddRow(3, 3, false);
  }
  const std::vector<double> weights(system.b.size(), 1.0);
  const double threshold = 1e-8;
  ASSERT_TRUE(Update(&system, {}, 0).ok());
  double worst = 0.0;
  int least = 80;
  for (int step = 0; step < 200; ++step) {
    const int row = 60 + system.random.Below(20);
    system.Perturb(row);
    const std::vector<int> rows{row};
    ASSERT_TRUE(Update(&system, {row, &rows}, 80, {weights.data(), threshold}).ok());
    least = std::min(least, tree_.work().solved_rows);
    const Eigen::VectorXd expected = system.Dense().llt().solve(system.FreeB());
    worst = std::max(worst, (system.X() - expected).cwiseAbs().maxCoeff());
  }
  EXPECT_LT(least, 80);
  EXPECT_GT(worst, 0.0);
  EXPECT_LE(worst, 10.0 * std::sqrt(threshold));
}

TEST_F(BayesTreeTest, TheSameBitsForAnyNumberOfThreads) {
  std::vector<double> results[2];
  const int threads[2] = {1, 3};
  for (int k = 0; k < 2; ++k) {
    const Executor executor(threads[k]);
    BayesTree tree(executor);
    GrowingSystem system(5);
    for (int i = 0; i < 60; ++i) {
      system.AddRow(6, 50, false);
    }
    ASSERT_TRUE(system.Factorize({}, &tree).ok());
    ASSERT_TRUE(system.Solve({}, kAllOfIt, &tree).ok());
    EXPECT_GT(tree.work().factor_flops, 4e6);
    results[k] = system.x;
  }
  EXPECT_EQ(results[0], results[1]);
}

}  // namespace
}  // namespace inceres::internal
