// What every solver promises of a reduced system that grows, whatever changed between two calls:
// the built-in ones, and the example of the documentation.
#include <cmath>
#include <limits>
#include <string>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "linear/bayes_tree.h"
#include "linear/eigen_ldlt_solver.h"
#include "linear/growing_system.h"
#include "linear/select_solver.h"
#include "support/dense_oracle.h"

namespace inceres::internal {
namespace {

// With an executor of its own.
struct OneThread {
  Executor executor{1};
};
struct BayesTreeOfOneThread : private OneThread, public BayesTree {
  BayesTreeOfOneThread() : BayesTree(OneThread::executor) {}
};

struct GrowingCase {
  const char* name;
  ReducedSolverKind kind = ReducedSolverKind::kAutomatic;
  ReducedSolverFactory factory;
};

constexpr ReducedSolver::Truncation kExact;

class GrowingSystemLaws : public testing::TestWithParam<GrowingCase> {
 protected:
  GrowingSystemLaws() { MakeAnew(); }

  void MakeAnew() {
    solver_ = MakeResumingSolver(GetParam().kind, GetParam().factory, {1e-12, 1000}, executor_);
  }
  bool IsBuiltIn() const { return GetParam().name != std::string("EigenLdlt"); }

  Status Update(GrowingSystem* system, const ReducedSolver::Rows& change, int first_b) {
    const Status status = system->Factorize(change, solver_.get());
    return status.ok() ? system->Solve({first_b}, kExact, solver_.get()) : status;
  }

  static void ExpectSolved(const GrowingSystem& system) {
    const Eigen::VectorXd expected = system.Dense().llt().solve(system.FreeB());
    EXPECT_LE(test::RelativeError(system.X(), expected), 1e-10);
    for (int i = 0; i < system.num_rows(); ++i) {
      if (system.held[static_cast<std::size_t>(i)] != 0) {
        EXPECT_TRUE(system.X().segment(system.OffsetOf(i), system.S.size_of(i)).isZero(0.0))
            << "held row " << i;
      }
    }
  }

  Executor executor_{1};
  std::unique_ptr<ReducedSolver> solver_;
};

TEST_P(GrowingSystemLaws, AgreesWithADenseOracleUnderRandomChanges) {
  for (unsigned seed = 0; seed < 6; ++seed) {
    GrowingSystem system(seed);
    MakeAnew();
    for (int step = 0; step < 40; ++step) {
      const RandomChange edit(&system, /*may_hold=*/true);
      const Status status = Update(&system, edit.change, edit.first_b);
      ASSERT_TRUE(status.ok()) << status.message;
      ASSERT_NO_FATAL_FAILURE(ExpectSolved(system)) << "seed " << seed << ", step " << step;
      ASSERT_FALSE(HasFailure()) << "seed " << seed << ", step " << step;
    }
    EXPECT_EQ(solver_->Bytes() > 0, IsBuiltIn());
    EXPECT_FALSE(std::string(solver_->Name()).empty());
  }
}

TEST_P(GrowingSystemLaws, ChangesMayComeWithoutAListOfRows) {
  GrowingSystem system(31);
  for (int step = 0; step < 40; ++step) {
    RandomChange edit(&system, /*may_hold=*/true);
    edit.change.rows = nullptr;
    ASSERT_TRUE(Update(&system, edit.change, edit.first_b).ok());
    ExpectSolved(system);
  }
}

TEST_P(GrowingSystemLaws, TheSameCallsGiveTheSameBits) {
  std::vector<double> results[2];
  for (std::vector<double>& result : results) {
    GrowingSystem system(5);
    MakeAnew();
    for (int step = 0; step < 30; ++step) {
      const RandomChange edit(&system, /*may_hold=*/true);
      ASSERT_TRUE(Update(&system, edit.change, edit.first_b).ok());
    }
    result = system.x;
  }
  EXPECT_EQ(results[0], results[1]);
}

TEST_P(GrowingSystemLaws, EverythingHeldOrNothingThere) {
  GrowingSystem system(1);
  if (IsBuiltIn()) {  // no other is asked where nothing is
    EXPECT_TRUE(Update(&system, {}, 0).ok());
  }
  system.AddRow(6, 0, false);
  system.AddRow(3, 1, false);
  system.held = {1, 1};
  ASSERT_TRUE(Update(&system, {}, 0).ok());
  EXPECT_EQ(system.x, std::vector<double>(9, 0.0));
}

// Rows keep their names when others go.
TEST_P(GrowingSystemLaws, TheRowThatIsNotPositiveDefiniteIsNamedAsItWas) {
  GrowingSystem system(8);
  for (int i = 0; i < 20; ++i) {
    system.AddRow(3, 3, i == 15);
  }
  system.RemoveRow(4);
  system.damping[static_cast<std::size_t>(system.OffsetOf(10))] = -1e6;
  const Status failed = Update(&system, {}, 0);
  EXPECT_EQ(failed.code, StatusCode::kSingular);
  if (IsBuiltIn()) {
    EXPECT_EQ(failed.message, "the reduced system is not positive definite at frame 10");
    EXPECT_EQ(solver_->work().failed_row, 10);
  }
}

TEST_P(GrowingSystemLaws, NotPositiveDefiniteIsSingularAndTheSolverWorksAgain) {
  GrowingSystem system(8);
  for (int i = 0; i < 20; ++i) {
    system.AddRow(3, 3, i == 15);
  }
  ASSERT_TRUE(Update(&system, {}, 0).ok());
  for (const double bad : {-1e6, std::numeric_limits<double>::quiet_NaN()}) {
    system.damping[31] = bad;
    const Status failed = Update(&system, {10, nullptr}, 20);
    EXPECT_EQ(failed.code, StatusCode::kSingular);
    EXPECT_NE(failed.message.find("not positive definite"), std::string::npos) << failed.message;
    if (IsBuiltIn()) {
      EXPECT_EQ(failed.message, "the reduced system is not positive definite at frame 10");
    }
    EXPECT_FALSE(IsBuiltIn() && system.Solve({20}, kExact, solver_.get()).ok());
    system.damping[31] = 0.25;
    ASSERT_TRUE(Update(&system, {10, nullptr}, 20).ok());
    ExpectSolved(system);
  }
}

// Diagonal blocks that are positive definite in a matrix that is not.
TEST_P(GrowingSystemLaws, AnIndefiniteCouplingIsSingular) {
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

INSTANTIATE_TEST_SUITE_P(
    Solvers, GrowingSystemLaws,
    testing::Values(GrowingCase{"Automatic", ReducedSolverKind::kAutomatic, nullptr},
                    GrowingCase{"Resumed", ReducedSolverKind::kResumed, nullptr},
                    GrowingCase{"Dense", ReducedSolverKind::kDense, nullptr},
                    GrowingCase{"Sparse", ReducedSolverKind::kSparse, nullptr},
                    GrowingCase{"Pcg", ReducedSolverKind::kPcg, nullptr},
                    GrowingCase{"BayesTree", ReducedSolverKind::kAutomatic,
                                [] { return std::make_unique<BayesTreeOfOneThread>(); }},
                    GrowingCase{"EigenLdlt", ReducedSolverKind::kAutomatic,
                                [] { return std::make_unique<EigenLdltSolver>(); }}),
    [](const auto& instance) { return instance.param.name; });

}  // namespace
}  // namespace inceres::internal
