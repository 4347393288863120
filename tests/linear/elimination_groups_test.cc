// Rows of S that are to be eliminated in groups: every factor keeps to them, through all edits, and
// its solutions are what they were.
#include <algorithm>
#include <functional>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "linear/bayes_tree.h"
#include "linear/elimination_order.h"
#include "linear/group_order.h"
#include "linear/group_pairs.h"
#include "linear/growing_system.h"
#include "linear/random_system.h"
#include "linear/select_solver.h"
#include "support/dense_oracle.h"

namespace inceres::internal {
namespace {

using Neighbors = std::vector<std::set<int>>;

std::vector<int> RandomGroups(int num_rows, test::Random* random) {
  std::vector<int> groups;
  for (int row = 0; row < num_rows; ++row) {
    groups.push_back(7 * random->Below(4));
  }
  return groups;
}

Neighbors NeighborsIn(const BlockPattern& pattern) {
  Neighbors neighbors(static_cast<std::size_t>(pattern.num_blocks()));
  for (int i = 0; i < pattern.num_blocks(); ++i) {
    const auto row = static_cast<std::size_t>(i);
    for (int k = pattern.row_begin[row]; k + 1 < pattern.row_begin[row + 1]; ++k) {
      const int j = pattern.columns[static_cast<std::size_t>(k)];
      neighbors[row].insert(j);
      neighbors[static_cast<std::size_t>(j)].insert(i);
    }
  }
  return neighbors;
}

Neighbors NeighborsIn(const SymmetricBlockRows& S) {
  Neighbors neighbors(static_cast<std::size_t>(S.num_rows()));
  for (int row = 0; row < S.num_rows(); ++row) {
    for (const SymmetricBlockRows::Entry& entry : S.row(row)) {
      if (entry.column != row) {
        neighbors[static_cast<std::size_t>(row)].insert(entry.column);
        neighbors[static_cast<std::size_t>(entry.column)].insert(row);
      }
    }
  }
  return neighbors;
}

class BatchGroups : public testing::TestWithParam<ReducedSolverKind> {};

TEST_P(BatchGroups, AreKeptTo) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    test::Random random(seed);
    std::vector<int> sizes;
    for (int i = 0; i < 60; ++i) {
      sizes.push_back(1 + random.Below(7));
    }
    RandomSystem system(sizes, RandomSystem::Fill::kBand, seed);
    const Executor executor(1);
    const auto solver_of = [&] {
      Status status;
      auto solver = MakeReducedSolver(GetParam(), nullptr, system.pattern, executor, &status);
      EXPECT_TRUE(status.ok()) << status.message;
      return solver;
    };
    const std::vector<int> groups = RandomGroups(60, &random);
    EXPECT_GT(CountMisplaced(EliminationOrderOf(*solver_of()), NeighborsIn(system.pattern), groups),
              0)
        << "the solver's own order is another";
    system.pattern.groups = groups;
    const auto solver = solver_of();
    std::vector<int> order = EliminationOrderOf(*solver);
    EXPECT_EQ(CountMisplaced(order, NeighborsIn(system.pattern), groups), 0) << "seed " << seed;
    std::sort(order.begin(), order.end());
    for (int row = 0; row < 60; ++row) {
      ASSERT_EQ(order[static_cast<std::size_t>(row)], row) << "each once";
    }
    ASSERT_TRUE(solver->Factorize(system.Matrix(), {}).ok());
    const std::vector<double> b = system.random.Vector(system.diagonal.size());
    Eigen::VectorXd x(system.pattern.size());
    ASSERT_TRUE(solver->Solve(b.data(), {}, {}, x.data()).ok());
    const Eigen::VectorXd expected = system.Dense().llt().solve(
        Eigen::Map<const Eigen::VectorXd>(b.data(), system.pattern.size()));
    EXPECT_LE(test::RelativeError(x, expected), 1e-10);
  }
}

// A group each, backwards: what no solver would choose.
TEST_P(BatchGroups, MayBeACompleteOrder) {
  RandomSystem system(std::vector<int>(30, 3), RandomSystem::Fill::kBand);
  for (int row = 0; row < 30; ++row) {
    system.pattern.groups.push_back(29 - row);
  }
  Status status;
  const Executor executor(1);
  const auto solver = MakeReducedSolver(GetParam(), nullptr, system.pattern, executor, &status);
  ASSERT_TRUE(status.ok());
  EXPECT_EQ(CountMisplaced(EliminationOrderOf(*solver), NeighborsIn(system.pattern),
                           system.pattern.groups),
            0);
}

INSTANTIATE_TEST_SUITE_P(Kinds, BatchGroups,
                         testing::Values(ReducedSolverKind::kDense, ReducedSolverKind::kSparse,
                                         ReducedSolverKind::kPcg));

// With an executor of its own.
struct OwnThread {
  Executor executor{1};
};
struct TreeOfOwnThread : private OwnThread, public BayesTree {
  TreeOfOwnThread() : BayesTree(OwnThread::executor) {}
};

struct LivingCase {
  const char* name;
  ReducedSolverKind kind = ReducedSolverKind::kAutomatic;
  ReducedSolverFactory factory;
};

class LivingGroups : public testing::TestWithParam<LivingCase> {};

// Rows come and go, blocks come, and rows change their group.
TEST_P(LivingGroups, AreKeptToWhateverIsEdited) {
  for (unsigned seed = 1; seed <= 8; ++seed) {
    GrowingSystem system(seed);
    const Executor executor(1);
    const auto solver =
        MakeResumingSolver(GetParam().kind, GetParam().factory, {1e-12, 1000}, executor);
    for (int step = 0; step < 40; ++step) {
      const int num_before = system.num_rows();
      RandomChange edit(&system, /*may_hold=*/true);
      for (int row = num_before; row < system.num_rows(); ++row) {
        system.S.SetGroup(row, 3 * system.random.Below(3));
      }
      if (step % 3 == 2) {
        const int row = system.random.Below(system.num_rows());
        if (system.S.size_of(row) > 0) {
          system.S.SetGroup(row, 3 * system.random.Below(3));
          edit.Touch(row);
          std::sort(edit.rows.begin(), edit.rows.end());
          edit.rows.erase(std::unique(edit.rows.begin(), edit.rows.end()), edit.rows.end());
        }
      }
      ASSERT_TRUE(system.Factorize(edit.change, solver.get()).ok());
      ASSERT_TRUE(system.Solve({edit.first_b}, {}, solver.get()).ok());
      const std::vector<int> order = EliminationOrderOf(*solver, system.S);
      std::vector<int> groups;
      int num_living = 0;
      for (int row = 0; row < system.num_rows(); ++row) {
        groups.push_back(system.S.group_of(row));
        num_living += system.S.size_of(row) > 0 ? 1 : 0;
      }
      ASSERT_EQ(static_cast<int>(order.size()), num_living);
      ASSERT_EQ(CountMisplaced(order, NeighborsIn(system.S), groups), 0)
          << "seed " << seed << ", step " << step;
      const Eigen::VectorXd expected = system.Dense().llt().solve(system.FreeB());
      ASSERT_LE(test::RelativeError(system.X(), expected), 1e-10)
          << "seed " << seed << ", step " << step;
    }
    EXPECT_TRUE(system.S.has_groups());
  }
}

INSTANTIATE_TEST_SUITE_P(
    Solvers, LivingGroups,
    testing::Values(LivingCase{"Automatic", ReducedSolverKind::kAutomatic, nullptr},
                    LivingCase{"Resumed", ReducedSolverKind::kResumed, nullptr},
                    LivingCase{"Dense", ReducedSolverKind::kDense, nullptr},
                    LivingCase{"Sparse", ReducedSolverKind::kSparse, nullptr},
                    LivingCase{"BayesTree", ReducedSolverKind::kAutomatic,
                               [] { return std::make_unique<TreeOfOwnThread>(); }}),
    [](const auto& instance) { return instance.param.name; });

TEST(Groups, ARowThatIsRemovedLeavesItsGroup) {
  SymmetricBlockRows S;
  S.AddRow(2);
  S.AddRow(3);
  EXPECT_FALSE(S.has_groups());
  EXPECT_TRUE(S.Pattern().groups.empty());
  const std::int64_t version = S.version();
  S.SetGroup(1, 0);
  EXPECT_EQ(S.version(), version);
  S.SetGroup(1, 5);
  EXPECT_NE(S.version(), version);
  EXPECT_EQ(S.Pattern().groups, (std::vector<int>{0, 5}));
  S.RemoveRow(1);
  EXPECT_FALSE(S.has_groups());
  S.ReviveRow(1, 4);
  EXPECT_EQ(S.group_of(1), 0);
}

TEST(Groups, RanksAreWithoutGaps) {
  EXPECT_EQ(RanksOf({7, 0, 2147483647, 7}), (std::vector<int>{1, 0, 2, 1}));
  EXPECT_TRUE(RanksOf({}).empty());
}

}  // namespace
}  // namespace inceres::internal
