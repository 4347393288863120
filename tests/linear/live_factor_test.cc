// Products with the inverse, from a factor that goes on to be resumed.
#include "linear/live_factor.h"

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "linear/automatic_solver.h"
#include "linear/dense_cholesky.h"
#include "linear/growing_system.h"
#include "linear/pcg_solver.h"
#include "support/dense_oracle.h"

namespace inceres::internal {
namespace {

std::vector<int> OffsetsOf(const GrowingSystem& system) {
  std::vector<int> offsets{0};
  for (int row = 0; row < system.num_rows(); ++row) {
    offsets.push_back(offsets.back() + system.S.size_of(row));
  }
  return offsets;
}

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

template <typename Solver>
void ExpectProducts(Solver* solver, unsigned seed) {
  GrowingSystem system(seed);
  for (int step = 0; step < 60; ++step) {
    const RandomChange edit(&system, /*may_hold=*/true);
    ASSERT_TRUE(system.Factorize(edit.change, solver).ok());
    const LiveFactor factor(solver);
    ASSERT_TRUE(factor.exists());
    const std::vector<int> offsets = OffsetsOf(system);
    const SparseColumns V = RandomColumns(&system);
    Eigen::MatrixXd whole = Eigen::MatrixXd::Zero(system.size(), 3);
    for (std::size_t k = 0; k < V.rows.size(); ++k) {
      const int size_of_row = system.S.size_of(V.rows[k]);
      whole.middleRows(offsets[V.rows[k]], size_of_row) =
          V.values.middleRows(V.begin[k], size_of_row);
    }
    const Eigen::MatrixXd dense = system.Dense();
    Eigen::MatrixXd product;
    ASSERT_TRUE(factor.Product(V, offsets, &product).ok());
    ASSERT_LE(test::RelativeError(product, whole.transpose() * dense.llt().solve(whole)), 1e-11)
        << "seed " << seed << ", step " << step;
    Eigen::VectorXd x = Eigen::VectorXd::Zero(system.size());
    const Eigen::VectorXd b = system.FreeB();
    ASSERT_TRUE(factor.Solve(offsets, b.data(), x.data()).ok());
    ASSERT_LE(test::RelativeError(x, dense.llt().solve(b)), 1e-11);
    // The solver's own solves go on as if nothing had been.
    ASSERT_TRUE(system.Solve({edit.first_b}, {}, solver).ok());
    ASSERT_LE(test::RelativeError(system.X(), x), 1e-11);
  }
}

TEST(LiveFactor, AgreesWithADenseOracleUnderManyRandomChanges) {
  const Executor executor(1);
  for (unsigned seed = 0; seed < 8; ++seed) {
    BayesTree tree(executor);
    ExpectProducts(&tree, seed);
    ResumedSolver resumed;
    ExpectProducts(&resumed, seed);
    AutomaticSolver automatic(executor);
    ExpectProducts(&automatic, seed);
  }
}

TEST(LiveFactor, ConjugateGradientsHaveNone) {
  PcgSolver solver{PcgOptions()};
  EXPECT_FALSE(LiveFactor(&solver).exists());
  EXPECT_FALSE(LiveFactor(nullptr).exists());
}

}  // namespace
}  // namespace inceres::internal
