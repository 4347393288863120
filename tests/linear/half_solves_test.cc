// What a step promises, before the step is known.
#include "linear/half_solves.h"

#include <algorithm>
#include <functional>
#include <memory>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "linear/automatic_solver.h"
#include "linear/growing_system.h"
#include "support/dense_oracle.h"

namespace inceres::internal {
namespace {

constexpr ReducedSolver::Truncation kAllOfIt;

double GainOf(const GrowingSystem& system) {
  const Eigen::VectorXd b = system.FreeB();
  return 0.5 * b.dot(system.Dense().llt().solve(b));
}

// In any succession of factorizations, first halves and whole solves.
template <typename Solver>
void ExpectExactGains(const std::function<std::unique_ptr<Solver>()>& make) {
  for (unsigned seed = 0; seed < 10; ++seed) {
    GrowingSystem system(seed);
    const std::unique_ptr<Solver> solver = make();
    int first_b = 0;
    for (int step = 0; step < 60; ++step) {
      const RandomChange edit(&system, /*may_hold=*/true);
      first_b = std::min(first_b, edit.first_b);
      ASSERT_TRUE(system.Factorize(edit.change, solver.get()).ok());
      if (step % 3 != 1) {
        double gain = -1.0;
        const Eigen::VectorXd b = system.FreeB();
        ASSERT_TRUE(solver->SolveForGain(b.data(), {first_b, nullptr}, &gain).ok());
        const double expected = GainOf(system);
        ASSERT_NEAR(gain, expected, 1e-11 * expected) << "seed " << seed << ", step " << step;
        first_b = system.num_rows();
      }
      if (step % 3 != 0) {
        ASSERT_TRUE(system.Solve({first_b}, kAllOfIt, solver.get()).ok());
        const Eigen::VectorXd expected = system.Dense().llt().solve(system.FreeB());
        ASSERT_LE(test::RelativeError(system.X(), expected), 1e-11)
            << "seed " << seed << ", step " << step;
        first_b = system.num_rows();
      }
    }
  }
}

TEST(HalfSolves, OfTheBayesTree) {
  const Executor executor(1);
  ExpectExactGains<BayesTree>([&] { return std::make_unique<BayesTree>(executor); });
}

TEST(HalfSolves, OfTheResumedSolver) {
  ExpectExactGains<ResumedSolver>([] { return std::make_unique<ResumedSolver>(); });
}

TEST(HalfSolves, OfTheAutomaticSolver) {
  const Executor executor(1);
  ExpectExactGains<AutomaticSolver>([&] { return std::make_unique<AutomaticSolver>(executor); });
}

TEST(HalfSolves, BeforeAFactorizationThereIsNoGain) {
  const Executor executor(1);
  BayesTree tree(executor);
  GrowingSystem system(1);
  system.AddRow(3, 1, false);
  double gain = -1.0;
  EXPECT_FALSE(tree.SolveForGain(system.b.data(), {}, &gain).ok());
  EXPECT_EQ(gain, -1.0);
}

}  // namespace
}  // namespace inceres::internal
