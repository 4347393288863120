// Incremental PCG: as good a step as Cholesky's where the matrix is bad, and what it keeps from
// call to call.
#include "linear/pcg_solver.h"

#include <cmath>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <gtest/gtest.h>

#include "linear/growing_system.h"

namespace inceres::internal {
namespace {

constexpr ReducedSolver::Truncation kExact;

Status Update(PcgSolver* solver, GrowingSystem* system, const ReducedSolver::Rows& change) {
  const Status status = system->Factorize(change, solver);
  return status.ok() ? system->Solve({}, kExact, solver) : status;
}

// ‖x − A⁻¹b‖_A / ‖A⁻¹b‖_A, in long double: in double the oracle itself would err by more.
double EnergyError(const GrowingSystem& system) {
  using Matrix = Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic>;
  using Vector = Eigen::Matrix<long double, Eigen::Dynamic, 1>;
  const Matrix A = system.Dense().cast<long double>();
  const Vector expected = A.llt().solve(system.FreeB().cast<long double>());
  const Vector error = system.X().cast<long double>() - expected;
  return static_cast<double>(std::sqrt(error.dot(A * error) / expected.dot(A * expected)));
}

// A pose graph without a prior: A = Σ (e_i − e_j)(e_i − e_j)ᵀ over odometry and a few loops, entry
// by entry, so the gauge is free and only damping holds it. The right-hand side comes from edges
// too: gradient of a cost.
GrowingSystem FreeGauge(int num_rows, double damping, double scale_of_last) {
  GrowingSystem system(2);
  system.coupling = 0.0;
  constexpr int kSize = 6;
  for (int i = 0; i < num_rows; ++i) {
    system.AddRow(kSize, 1, false);
  }
  for (int i = 0; i < num_rows; ++i) {
    double* block = system.S.values(system.S.FindOrAdd(i, i));
    std::fill_n(block, kSize * PadToQuad(kSize), 0.0);
  }
  std::fill(system.b.begin(), system.b.end(), 0.0);
  const auto connect = [&](int i, int j, double weight) {  // i > j
    for (int k = 0; k < kSize; ++k) {
      const int at = k * PadToQuad(kSize) + k;
      system.S.values(system.S.FindOrAdd(i, i))[at] += weight;
      system.S.values(system.S.FindOrAdd(j, j))[at] += weight;
      system.S.values(system.S.FindOrAdd(i, j))[at] -= weight;
      const double force = weight * system.random.Unit();
      system.b[static_cast<std::size_t>(i * kSize + k)] += force;
      system.b[static_cast<std::size_t>(j * kSize + k)] -= force;
    }
  };
  for (int i = 1; i < num_rows; ++i) {
    connect(i, i - 1, i == num_rows - 1 ? scale_of_last : 1.0 + system.random.Unit() * 0.5);
    if (i % 17 == 16) {
      connect(i, i - 16, 1.0);
    }
  }
  std::fill(system.damping.begin(), system.damping.end(), damping);
  std::fill(system.x.begin(), system.x.end(), 0.0);
  return system;
}

TEST(PcgSolver, PriorsOfFourteenOrdersAreNoObstacle) {
  GrowingSystem system(4);
  for (int i = 0; i < 60; ++i) {
    system.AddRow(6, 3, i % 10 == 9);
  }
  for (const int row : {0, 17, 40}) {
    double* block = system.S.values(system.S.FindOrAdd(row, row));
    for (int k = 0; k < (row == 17 ? 3 : 6); ++k) {  // of row 17 only half the entries
      block[k * PadToQuad(6) + k] += 1e14;
    }
  }
  PcgSolver solver({1e-10, 5000});
  ASSERT_TRUE(Update(&solver, &system, {}).ok());
  EXPECT_TRUE(solver.work().converged);
  EXPECT_LT(solver.work().iterations, 60);
  EXPECT_LE(EnergyError(system), 1e-10);
}

TEST(PcgSolver, AGaugeThatDampingAloneHolds) {
  for (const double damping : {1e-4, 1e-8, 1e-11}) {
    for (const double scale : {1.0, 1e8, 1e14}) {
      GrowingSystem system = FreeGauge(60, damping, scale);
      for (const double tolerance : {1e-3, 1e-6}) {
        std::fill(system.x.begin(), system.x.end(), 0.0);
        PcgSolver solver({tolerance, 5000});
        ASSERT_TRUE(Update(&solver, &system, {}).ok());
        EXPECT_TRUE(solver.work().converged);
        EXPECT_LE(EnergyError(system), tolerance) << "damping " << damping << ", scale " << scale;
      }
    }
  }
}

TEST(PcgSolver, AWarmStartTakesFewerIterations) {
  GrowingSystem system = FreeGauge(150, 1e-3, 1.0);
  PcgSolver solver({1e-6, 5000});
  ASSERT_TRUE(Update(&solver, &system, {}).ok());
  const int cold = solver.work().iterations;
  for (std::size_t k = system.b.size() - 6; k < system.b.size();
       ++k) {  // a factor between the last two has another residual
    const double force = 0.01 * system.random.Unit();
    system.b[k] += force;
    system.b[k - 6] -= force;
  }
  ASSERT_TRUE(Update(&solver, &system, {150, nullptr}).ok());
  EXPECT_LT(solver.work().iterations, 2 * cold / 3);
  EXPECT_LE(EnergyError(system), 1e-6);
}

TEST(PcgSolver, AStartWorseThanZeroIsNotTaken) {
  GrowingSystem system = FreeGauge(50, 1e-3, 1.0);
  PcgSolver cold({1e-6, 5000});
  ASSERT_TRUE(Update(&cold, &system, {}).ok());
  for (double& entry : system.x) {
    entry *= -1e6;
  }
  PcgSolver solver({1e-6, 5000});
  ASSERT_TRUE(Update(&solver, &system, {}).ok());
  EXPECT_EQ(solver.work().iterations, cold.work().iterations);
}

TEST(PcgSolver, InvertsOnlyTheBlocksThatChanged) {
  GrowingSystem system = FreeGauge(80, 1e-2, 1.0);
  PcgSolver solver({1e-9, 5000});
  ASSERT_TRUE(Update(&solver, &system, {}).ok());
  EXPECT_EQ(solver.work().factored_rows, 80);
  system.Perturb(20);
  system.Perturb(50);
  system.held[60] = 1;
  const std::vector<int> rows{20, 50, 60};
  ASSERT_TRUE(Update(&solver, &system, {20, &rows}).ok());
  EXPECT_EQ(solver.work().factored_rows, 2);
  EXPECT_LE(EnergyError(system), 1e-8);
  system.AddRow(6, 2, false);
  const std::vector<int> none;
  ASSERT_TRUE(Update(&solver, &system, {80, &none}).ok());
  EXPECT_EQ(solver.work().factored_rows, 1);
  EXPECT_LE(EnergyError(system), 1e-8);
}

// Cut short it still promises a decrease: bᵀx − ½ xᵀAx > 0, and more with more iterations.
TEST(PcgSolver, CutShortItIsStillAStepDownhill) {
  double last = 0.0;
  for (const int iterations : {1, 3, 10, 30}) {
    GrowingSystem system = FreeGauge(150, 1e-6, 1.0);
    PcgSolver solver({1e-6, iterations});
    ASSERT_TRUE(Update(&solver, &system, {}).ok());
    EXPECT_FALSE(solver.work().converged);
    EXPECT_EQ(solver.work().iterations, iterations);
    const double decrease =
        system.FreeB().dot(system.X()) - 0.5 * system.X().dot(system.Dense() * system.X());
    EXPECT_GT(decrease, last);
    last = decrease;
  }
}

}  // namespace
}  // namespace inceres::internal
