// What every solver of a living reduced system promises, whatever changed between two calls.
#include <cmath>
#include <limits>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "linear/growing_system.h"
#include "linear/select_incremental_solver.h"
#include "support/dense_oracle.h"

namespace inceres::internal {
namespace {

using Kind = ReducedSolverKind;

constexpr IncrementalReducedSolver::Truncation kExact;

class IncrementalReducedSolverLaws : public testing::TestWithParam<Kind> {
 protected:
  IncrementalReducedSolverLaws() : solver_(MakeIncrementalReducedSolver(GetParam(), nullptr, {1e-12, 1000}, executor_)) {}

  Status Update(GrowingSystem* system, const IncrementalReducedSolver::Change& change, int first_b) {
    const Status status = solver_->Factorize(system->S, system->damping.data(), system->held.data(), change);
    return status.ok() ? solver_->Solve(system->b.data(), {first_b}, kExact, system->x.data()) : status;
  }

  static void ExpectSolved(const GrowingSystem& system) {
    const Eigen::VectorXd expected = system.Dense().llt().solve(system.FreeB());
    EXPECT_LE(test::RelativeError(system.X(), expected), 1e-10);
    for (int i = 0; i < system.num_rows(); ++i) {
      if (system.held[static_cast<std::size_t>(i)] != 0) {
        EXPECT_TRUE(system.X().segment(system.OffsetOf(i), system.S.size_of(i)).isZero(0.0)) << "held row " << i;
      }
    }
  }

  Executor executor_{1};
  std::unique_ptr<IncrementalReducedSolver> solver_;
};

TEST_P(IncrementalReducedSolverLaws, AgreesWithADenseOracleUnderRandomChanges) {
  for (unsigned seed = 0; seed < 6; ++seed) {
    GrowingSystem system(seed);
    solver_ = MakeIncrementalReducedSolver(GetParam(), nullptr, {1e-12, 1000}, executor_);
    for (int step = 0; step < 40; ++step) {
      const RandomChange edit(&system, /*may_hold=*/true);
      const Status status = Update(&system, edit.change, edit.first_b);
      ASSERT_TRUE(status.ok()) << status.message;
      ASSERT_NO_FATAL_FAILURE(ExpectSolved(system)) << "seed " << seed << ", step " << step;
      ASSERT_FALSE(HasFailure()) << "seed " << seed << ", step " << step;
    }
    EXPECT_GT(solver_->Bytes(), 0u);
    EXPECT_FALSE(std::string(solver_->Name()).empty());
  }
}

TEST_P(IncrementalReducedSolverLaws, ChangesMayComeWithoutAListOfRows) {
  GrowingSystem system(31);
  for (int step = 0; step < 40; ++step) {
    RandomChange edit(&system, /*may_hold=*/true);
    edit.change.rows = nullptr;
    ASSERT_TRUE(Update(&system, edit.change, edit.first_b).ok());
    ExpectSolved(system);
  }
}

TEST_P(IncrementalReducedSolverLaws, TheSameCallsGiveTheSameBits) {
  std::vector<double> results[2];
  for (std::vector<double>& result : results) {
    GrowingSystem system(5);
    solver_ = MakeIncrementalReducedSolver(GetParam(), nullptr, {}, executor_);
    for (int step = 0; step < 30; ++step) {
      const RandomChange edit(&system, /*may_hold=*/true);
      ASSERT_TRUE(Update(&system, edit.change, edit.first_b).ok());
    }
    result = system.x;
  }
  EXPECT_EQ(results[0], results[1]);
}

TEST_P(IncrementalReducedSolverLaws, EverythingHeldOrNothingThere) {
  GrowingSystem system(1);
  EXPECT_TRUE(Update(&system, {}, 0).ok());
  system.AddRow(6, 0, false);
  system.AddRow(3, 1, false);
  system.held = {1, 1};
  ASSERT_TRUE(Update(&system, {}, 0).ok());
  EXPECT_EQ(system.x, std::vector<double>(9, 0.0));
}

TEST_P(IncrementalReducedSolverLaws, NotPositiveDefiniteIsSingularAndTheSolverWorksAgain) {
  GrowingSystem system(8);
  for (int i = 0; i < 20; ++i) {
    system.AddRow(3, 3, i == 15);
  }
  ASSERT_TRUE(Update(&system, {}, 0).ok());
  for (const double bad : {-1e6, std::numeric_limits<double>::quiet_NaN()}) {
    system.damping[31] = bad;
    const Status failed = Update(&system, {10, nullptr, false}, 20);
    EXPECT_EQ(failed.code, StatusCode::kSingular);
    EXPECT_NE(failed.message.find("not positive definite"), std::string::npos) << failed.message;
    EXPECT_FALSE(solver_->Solve(system.b.data(), {20}, kExact, system.x.data()).ok());
    system.damping[31] = 0.25;
    ASSERT_TRUE(Update(&system, {10, nullptr, false}, 20).ok());
    ExpectSolved(system);
  }
}

// Diagonal blocks that are positive definite in a matrix that is not.
TEST_P(IncrementalReducedSolverLaws, AnIndefiniteCouplingIsSingular) {
  GrowingSystem system(8);
  system.coupling = 0.0;
  for (int i = 0; i < 4; ++i) {
    system.AddRow(2, 1, false);
  }
  system.S.values(system.S.FindOrAdd(3, 2))[0] = 500.0;
  const Status failed = Update(&system, {}, 0);
  EXPECT_EQ(failed.code, StatusCode::kSingular);
  EXPECT_NE(failed.message.find("not positive definite"), std::string::npos) << failed.message;
}

std::string NameOf(const testing::TestParamInfo<Kind>& instance) {
  const char* names[] = {"Automatic", "Resumed", "Dense", "Sparse", "Pcg"};
  return names[static_cast<int>(instance.param)];
}

INSTANTIATE_TEST_SUITE_P(Kinds, IncrementalReducedSolverLaws,
                         testing::Values(Kind::kAutomatic, Kind::kResumed, Kind::kDense, Kind::kSparse, Kind::kPcg), NameOf);

}  // namespace
}  // namespace inceres::internal
