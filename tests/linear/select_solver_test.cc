#include "linear/select_solver.h"

#include <set>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "linear/eigen_ldlt_solver.h"
#include "linear/random_system.h"

namespace inceres::internal {
namespace {

using Fill = RandomSystem::Fill;

class SelectSolver : public testing::Test {
 protected:
  std::string NameFor(ReducedSolverKind kind, const BlockPattern& pattern) {
    Status status = Status::Error(StatusCode::kUnavailable, "not set");
    const auto solver = MakeReducedSolver(kind, nullptr, pattern, executor_, &status);
    EXPECT_TRUE(status.ok()) << status.message;
    return solver->Name();
  }

  static RandomSystem Blocks(int count, Fill fill) {
    return {std::vector<int>(static_cast<std::size_t>(count), 6), fill};
  }

  Executor executor_{1};
};

TEST_F(SelectSolver, AutomaticIsDenseForSmallSystems) {
  EXPECT_EQ(NameFor(ReducedSolverKind::kAutomatic, Blocks(20, Fill::kBand).pattern),
            "dense Cholesky");
}

TEST_F(SelectSolver, AutomaticIsDenseForFullSystems) {
  EXPECT_EQ(NameFor(ReducedSolverKind::kAutomatic, Blocks(70, Fill::kDense).pattern),
            "dense Cholesky");
}

TEST_F(SelectSolver, AutomaticIsSparseForLongBands) {
  EXPECT_EQ(NameFor(ReducedSolverKind::kAutomatic, Blocks(1000, Fill::kBand).pattern).substr(0, 15),
            "sparse Cholesky");
}

// Poses that share landmarks over ten frames, speeds and biases that know their neighbors in time:
// far from full.
TEST_F(SelectSolver, AutomaticIsSparseForAWindowOfInertialFrames) {
  constexpr int kFrames = 50;
  std::vector<int> sizes;
  std::set<std::pair<int, int>> coupled;
  for (int i = 0; i < kFrames; ++i) {
    const int pose = 2 * i, speed_bias = 2 * i + 1;
    sizes.insert(sizes.end(), {6, 9});
    coupled.emplace(speed_bias, pose);
    for (int j = i - 10; j < i; ++j) {
      if (j >= 0) {
        coupled.emplace(pose, 2 * j);
      }
    }
    if (i > 0) {
      coupled.insert(
          {{pose, speed_bias - 2}, {speed_bias, pose - 2}, {speed_bias, speed_bias - 2}});
    }
  }
  EXPECT_EQ(
      NameFor(ReducedSolverKind::kAutomatic, RandomSystem(sizes, coupled).pattern).substr(0, 15),
      "sparse Cholesky");
}

TEST_F(SelectSolver, AutomaticInexactIteratesWhereFactoringWouldTakeLonger) {
  const auto kind = ReducedSolverKind::kAutomaticInexact;
  EXPECT_EQ(NameFor(kind, Blocks(20, Fill::kBand).pattern), "dense Cholesky");
  EXPECT_EQ(NameFor(kind, Blocks(1000, Fill::kBand).pattern).substr(0, 15), "sparse Cholesky");
  EXPECT_EQ(NameFor(kind, Blocks(400, Fill::kDense).pattern).substr(0, 3), "PCG");
  EXPECT_EQ(NameFor(ReducedSolverKind::kAutomatic, Blocks(400, Fill::kDense).pattern),
            "dense Cholesky");
}

// What the choice has analyzed serves as the factor.
TEST_F(SelectSolver, PcgIsReadyToFactorize) {
  const RandomSystem system = Blocks(3, Fill::kDense);
  Status status;
  const auto solver =
      MakeReducedSolver(ReducedSolverKind::kPcg, nullptr, system.pattern, executor_, &status);
  ASSERT_TRUE(status.ok());
  ASSERT_TRUE(solver->Factorize(system.Matrix(), {}).ok());
  std::vector<double> x(static_cast<std::size_t>(system.pattern.size()));
  const std::vector<double> b(x.size(), 1.0);
  EXPECT_TRUE(solver->Solve(b.data(), {}, {}, x.data()).ok());
}

TEST_F(SelectSolver, AWishIsGranted) {
  EXPECT_EQ(NameFor(ReducedSolverKind::kDense, Blocks(100, Fill::kBand).pattern), "dense Cholesky");
  EXPECT_EQ(NameFor(ReducedSolverKind::kPcg, Blocks(3, Fill::kDense).pattern).substr(0, 3), "PCG");
  EXPECT_EQ(NameFor(ReducedSolverKind::kSparse, Blocks(3, Fill::kDense).pattern).substr(0, 15),
            "sparse Cholesky");
}

TEST_F(SelectSolver, TheFactoryGoesBeforeEveryKind) {
  const RandomSystem system = Blocks(3, Fill::kDense);
  for (const auto kind :
       {ReducedSolverKind::kAutomatic, ReducedSolverKind::kDense, ReducedSolverKind::kSparse}) {
    Status status;
    const auto solver = MakeReducedSolver(
        kind, [] { return std::make_unique<EigenLdltSolver>(); }, system.pattern, executor_,
        &status);
    ASSERT_TRUE(status.ok());
    EXPECT_STREQ(solver->Name(), "Eigen LDLT");
    EXPECT_TRUE(solver->Factorize(system.Matrix(), {}).ok()) << "is analyzed already";
  }
}

TEST_F(SelectSolver, AFactoryThatReturnsNullIsNamed) {
  const RandomSystem system = Blocks(3, Fill::kDense);
  Status status;
  const auto solver = MakeReducedSolver(
      ReducedSolverKind::kAutomatic, [] { return std::unique_ptr<ReducedSolver>(); },
      system.pattern, executor_, &status);
  EXPECT_EQ(solver, nullptr);
  EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
  EXPECT_EQ(status.message, "SolverOptions::reduced_solver_factory returned null");
}

}  // namespace
}  // namespace inceres::internal
