// What every solver promises of a reduced system that grows, whatever changed between two calls:
// the built-in ones, and the example of the documentation.
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "linear/bayes_tree.h"
#include "linear/eigen_ldlt_solver.h"
#include "linear/growing_system.h"
#include "linear/live_factor.h"
#include "linear/resuming.h"
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

// Beside what each solver does, some are HalfSolves, and of some there is a LiveFactor.
enum Abilities { kSolves, kIsAFactor, kIsAFactorAndHalfSolves };

struct GrowingCase {
  const char* name;
  Abilities abilities = kSolves;
  ReducedSolverKind kind = ReducedSolverKind::kAutomatic;
  ReducedSolverFactory factory;
};

constexpr ReducedSolver::Truncation kExact;

// Three columns of two rows of S that are there and free.
SparseColumns RandomColumns(GrowingSystem* system) {
  SparseColumns V;
  int size = 0;
  for (int k = 0; k < 50 && V.rows.size() < 2; ++k) {
    const int row = system->random.Below(system->num_rows());
    if (system->S.size_of(row) > 0 && system->held[row] == 0 &&
        (V.rows.empty() || V.rows.front() != row)) {
      V.rows.push_back(row);
      V.begin.push_back(size);
      size += system->S.size_of(row);
    }
  }
  V.values.resize(size, 3);
  for (Eigen::Index k = 0; k < V.values.size(); ++k) {
    V.values(k) = system->random.Unit();
  }
  return V;
}

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
    EXPECT_LE(test::RelativeError(system.X(), expected), 1e-11);
    for (int i = 0; i < system.num_rows(); ++i) {
      if (system.held[static_cast<std::size_t>(i)] != 0) {
        EXPECT_TRUE(system.X().segment(system.OffsetOf(i), system.S.size_of(i)).isZero(0.0))
            << "held row " << i;
      }
    }
  }

  // Takes up b.
  static void ExpectGain(const GrowingSystem& system, int first_b, HalfSolves* solver) {
    const Eigen::VectorXd b = system.FreeB();
    double gain = -1.0;
    ASSERT_TRUE(solver->SolveForGain(b.data(), {first_b}, &gain).ok());
    const double expected = 0.5 * b.dot(system.Dense().llt().solve(b));
    EXPECT_NEAR(gain, expected, 1e-11 * expected);
  }

  // Which the solver is not to notice.
  static void ExpectProductsWithTheInverse(const LiveFactor& factor, GrowingSystem* system) {
    std::vector<int> offsets;
    for (int row = 0; row <= system->num_rows(); ++row) {
      offsets.push_back(system->OffsetOf(row));
    }
    const SparseColumns V = RandomColumns(system);
    Eigen::MatrixXd whole = Eigen::MatrixXd::Zero(system->size(), 3);
    for (std::size_t k = 0; k < V.rows.size(); ++k) {
      const int size_of_row = system->S.size_of(V.rows[k]);
      whole.middleRows(offsets[V.rows[k]], size_of_row) =
          V.values.middleRows(V.begin[k], size_of_row);
    }
    const Eigen::LLT<Eigen::MatrixXd> dense(system->Dense());
    Eigen::MatrixXd product;
    ASSERT_TRUE(factor.Product(V, offsets, &product).ok());
    EXPECT_LE(test::RelativeError(product, whole.transpose() * dense.solve(whole)), 1e-11);
    Eigen::VectorXd x = Eigen::VectorXd::Zero(system->size());
    const Eigen::VectorXd b = system->FreeB();
    ASSERT_TRUE(factor.Solve(offsets, b.data(), x.data()).ok());
    EXPECT_LE(test::RelativeError(x, dense.solve(b)), 1e-11);
  }

  Executor executor_{1};
  std::unique_ptr<ReducedSolver> solver_;
};

TEST_P(GrowingSystemLaws, AgreesWithADenseOracleUnderRandomChanges) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    GrowingSystem system(seed);
    MakeAnew();
    for (int step = 0; step < 80; ++step) {
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

// Factorizations, first halves of solves, products with the inverse and whole solves, in any
// succession.
TEST_P(GrowingSystemLaws, WhatItCanDoBesideAgreesAsWell) {
  for (unsigned seed = 0; seed < 10; ++seed) {
    GrowingSystem system(seed);
    MakeAnew();
    auto* const halves = dynamic_cast<HalfSolves*>(solver_.get());
    ASSERT_EQ(halves != nullptr, GetParam().abilities == kIsAFactorAndHalfSolves);
    int first_b = 0;
    for (int step = 0; step < 60; ++step) {
      SCOPED_TRACE("seed " + std::to_string(seed) + ", step " + std::to_string(step));
      const RandomChange edit(&system, /*may_hold=*/true);
      first_b = std::min(first_b, edit.first_b);
      ASSERT_TRUE(system.Factorize(edit.change, solver_.get()).ok());
      if (halves != nullptr && system.random.Below(2) == 0) {
        ASSERT_NO_FATAL_FAILURE(
            ExpectGain(system, std::exchange(first_b, system.num_rows()), halves));
      }
      const LiveFactor factor(solver_.get());
      ASSERT_EQ(factor.exists(), GetParam().abilities != kSolves);
      if (factor.exists()) {
        ASSERT_NO_FATAL_FAILURE(ExpectProductsWithTheInverse(factor, &system));
      }
      if (system.random.Below(2) == 0) {
        ASSERT_TRUE(
            system.Solve({std::exchange(first_b, system.num_rows())}, kExact, solver_.get()).ok());
        ExpectSolved(system);
      }
      ASSERT_FALSE(HasFailure());
    }
  }
}

TEST(LiveFactor, OfNoSolverThereIsNone) {
  EXPECT_FALSE(LiveFactor(nullptr).exists());
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
    testing::Values(
        GrowingCase{"Automatic", kIsAFactorAndHalfSolves, ReducedSolverKind::kAutomatic, nullptr},
        GrowingCase{"Resumed", kIsAFactorAndHalfSolves, ReducedSolverKind::kResumed, nullptr},
        GrowingCase{"Dense", kIsAFactor, ReducedSolverKind::kDense, nullptr},
        GrowingCase{"Sparse", kIsAFactor, ReducedSolverKind::kSparse, nullptr},
        GrowingCase{"Pcg", kSolves, ReducedSolverKind::kPcg, nullptr},
        GrowingCase{"BayesTree", kIsAFactorAndHalfSolves, ReducedSolverKind::kAutomatic,
                    [] { return std::make_unique<BayesTreeOfOneThread>(); }},
        GrowingCase{"EigenLdlt", kSolves, ReducedSolverKind::kAutomatic,
                    [] { return std::make_unique<EigenLdltSolver>(); }}),
    [](const auto& instance) { return instance.param.name; });

}  // namespace
}  // namespace inceres::internal
