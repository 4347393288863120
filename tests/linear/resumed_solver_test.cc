// The resumed factor and substitutions: without truncation the same bits as from scratch, with it an error that stays bounded,
// and in either case no work on rows that nothing reaches.
#include "linear/resumed_solver.h"

#include <cmath>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "linear/growing_system.h"

namespace inceres::internal {
namespace {

constexpr LiveReducedSolver::Truncation kExact;

Status Update(LiveReducedSolver* solver, GrowingSystem* system, const LiveReducedSolver::Change& change, int first_b,
              const LiveReducedSolver::Truncation& truncation = kExact) {
  const Status status = solver->Factorize(system->S, system->damping.data(), system->held.data(), change);
  return status.ok() ? solver->Solve(system->b.data(), first_b, truncation, system->x.data()) : status;
}

std::vector<double> FromScratch(const GrowingSystem& system) {
  EnvelopeCholesky cholesky;
  EXPECT_TRUE(cholesky.Factorize(system.S, system.damping.data(), 0, system.held.data()).ok());
  std::vector<double> x(system.b.size());
  cholesky.Solve(system.b.data(), x.data());
  return x;
}

GrowingSystem Chain(int length, int size = 6) {
  GrowingSystem system(1);
  for (int i = 0; i < length; ++i) {
    system.AddRow(size, 2, false);
  }
  return system;
}

TEST(ResumedSolver, SameBitsAsFromScratchUnderRandomChanges) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    GrowingSystem system(seed);
    ResumedSolver solver;
    for (int step = 0; step < 60; ++step) {
      const RandomChange edit(&system, /*may_hold=*/true);
      ASSERT_TRUE(Update(&solver, &system, edit.change, edit.first_b).ok());
      ASSERT_EQ(system.x, FromScratch(system)) << "seed " << seed << ", step " << step;
    }
    const Eigen::VectorXd expected = system.Dense().llt().solve(system.FreeB());
    EXPECT_LE((system.X() - expected).norm(), 1e-12 * expected.norm());
  }
}

TEST(ResumedSolver, FactorsOftenerThanItSolves) {
  GrowingSystem system(3);
  ResumedSolver solver;
  int first_b = 0;
  for (int step = 0; step < 100; ++step) {
    const RandomChange edit(&system, /*may_hold=*/true);
    first_b = std::min(first_b, edit.first_b);
    ASSERT_TRUE(solver.Factorize(system.S, system.damping.data(), system.held.data(), edit.change).ok());
    if (step % 5 == 4) {
      ASSERT_TRUE(solver.Solve(system.b.data(), first_b, kExact, system.x.data()).ok());
      ASSERT_EQ(system.x, FromScratch(system)) << step;
      first_b = system.num_rows();
    }
  }
}

TEST(ResumedSolver, HeldRowsAreZeroAndFreedOnesComeBack) {
  GrowingSystem system = Chain(10, 3);
  ResumedSolver solver;
  ASSERT_TRUE(Update(&solver, &system, {}, 0).ok());
  const std::vector<double> before = system.x;
  system.held[4] = system.held[7] = 1;
  ASSERT_TRUE(Update(&solver, &system, {4, nullptr, false}, 10).ok());
  EXPECT_EQ(solver.work().factored_rows, 6);
  EXPECT_TRUE(system.X().segment(12, 3).isZero(0.0));
  EXPECT_TRUE(system.X().segment(21, 3).isZero(0.0));
  EXPECT_FALSE(system.X().segment(15, 3).isZero(1e-3));
  system.held[4] = system.held[7] = 0;
  ASSERT_TRUE(Update(&solver, &system, {4, nullptr, false}, 10).ok());
  EXPECT_EQ(system.x, before);
}

TEST(ResumedSolver, AnAppendedRowTouchesTheTailOnly) {
  GrowingSystem system = Chain(500);
  ResumedSolver solver;
  ASSERT_TRUE(Update(&solver, &system, {}, 0).ok());
  EXPECT_EQ(solver.work().factored_rows, 500);
  EXPECT_EQ(solver.work().first_solved_row, 0);
  system.AddRow(6, 2, false);
  ASSERT_TRUE(Update(&solver, &system, {500, nullptr, true}, 500, {system.damping.data(), 1e-14}).ok());
  EXPECT_EQ(solver.work().factored_rows, 1);
  EXPECT_EQ(solver.work().forward_rows, 1);
  EXPECT_LT(solver.work().solved_rows, 20);
  EXPECT_EQ(solver.work().first_solved_row, 501 - solver.work().solved_rows);
  EXPECT_LT(solver.work().factor_flops, 6000.0);
}

TEST(ResumedSolver, NothingChangedIsNothingDone) {
  GrowingSystem system = Chain(50);
  ResumedSolver solver;
  ASSERT_TRUE(Update(&solver, &system, {}, 0).ok());
  const std::vector<double> before = system.x;
  ASSERT_TRUE(Update(&solver, &system, {50, nullptr, false}, 50).ok());
  EXPECT_EQ(solver.work().factored_rows, 0);
  EXPECT_EQ(solver.work().solved_rows, 0);
  EXPECT_EQ(system.x, before);
}

// A change far down the rows is stopped by the threshold; one that reaches a far row by a loop goes there.
TEST(ResumedSolver, ALoopCarriesTheChangeToItsEnd) {
  GrowingSystem system = Chain(300);
  system.Couple(299, 100);
  ResumedSolver solver;
  const LiveReducedSolver::Truncation truncation{system.damping.data(), 1e-16};
  ASSERT_TRUE(Update(&solver, &system, {}, 0, truncation).ok());
  system.Perturb(299);
  ASSERT_TRUE(Update(&solver, &system, {299, nullptr, false}, 300, truncation).ok());
  EXPECT_EQ(solver.work().factored_rows, 1);
  EXPECT_LE(solver.work().first_solved_row, 100);
  EXPECT_GT(solver.work().first_solved_row, 70);
}

// Many steps, each of which truncates: the error does not add up. Weights 1: the bound on a row's change is sqrt(threshold).
TEST(ResumedSolver, TheErrorOfTruncationStaysBounded) {
  GrowingSystem system(11);
  system.diagonal_entry = 8.0;  // changes die away slowly
  for (int i = 0; i < 80; ++i) {
    system.AddRow(3, 3, false);
  }
  ResumedSolver solver;
  constexpr double kThreshold = 1e-10;
  int left_out = 0;
  for (int step = 0; step < 400; ++step) {
    // Small pushes in one direction: each of them alone is below the threshold further up.
    const int row = step == 0 ? 0 : 70 + system.random.Below(10);
    system.b[static_cast<std::size_t>(system.OffsetOf(row))] += 1e-4;
    const std::vector<double> weights(system.b.size(), 1.0);
    ASSERT_TRUE(Update(&solver, &system, {step == 0 ? 0 : row, nullptr, false}, row, {weights.data(), kThreshold}).ok());
    left_out += solver.work().first_solved_row > 0;
    const Eigen::VectorXd expected = system.Dense().llt().solve(system.FreeB());
    ASSERT_LE((system.X() - expected).lpNorm<Eigen::Infinity>(), 2.0 * std::sqrt(kThreshold)) << step;
  }
  EXPECT_GT(left_out, 390);
}

// The caller applies a part of the solution: b and x follow there, and the rest is still the solution.
TEST(ResumedSolver, GoesOnFromAPartlyAppliedSolution) {
  GrowingSystem system = Chain(60);
  std::fill(system.damping.begin(), system.damping.end(), 0.0);
  ResumedSolver solver;
  const std::vector<double> weights(system.b.size(), 1.0);
  ASSERT_TRUE(Update(&solver, &system, {}, 0, {weights.data(), 1e-20}).ok());
  Eigen::VectorXd applied = Eigen::VectorXd::Zero(system.size());
  applied.tail(60) = system.X().tail(60);  // the last ten rows
  const Eigen::VectorXd b = system.FreeB() - system.Dense() * applied;
  std::copy(b.begin(), b.end(), system.b.begin());
  for (std::size_t k = 300; k < 360; ++k) {
    system.x[k] = 0.0;
  }
  ASSERT_TRUE(Update(&solver, &system, {60, nullptr, false}, 48, {weights.data(), 1e-20}).ok());
  EXPECT_GT(solver.work().first_solved_row, 20);
  EXPECT_LE((system.X() - system.Dense().llt().solve(b)).lpNorm<Eigen::Infinity>(), 1e-9);
}

TEST(ResumedSolver, RecoversFromASingularRow) {
  GrowingSystem system = Chain(12, 3);
  ResumedSolver solver;
  ASSERT_TRUE(Update(&solver, &system, {}, 0).ok());
  system.damping[24] = -1000.0;
  const Status failed = Update(&solver, &system, {8, nullptr, false}, 12);
  EXPECT_EQ(failed.code, StatusCode::kSingular);
  EXPECT_NE(failed.message.find("block row 8"), std::string::npos) << failed.message;
  EXPECT_EQ(solver.Solve(system.b.data(), 12, kExact, system.x.data()).code, StatusCode::kSingular);
  system.damping[24] = 0.25;
  ASSERT_TRUE(Update(&solver, &system, {8, nullptr, false}, 12).ok());
  EXPECT_EQ(solver.work().factored_rows, 4);
  EXPECT_EQ(system.x, FromScratch(system));
}

// Against a count of the multiplications and additions of a textbook factorisation inside the envelope.
TEST(ResumedSolver, PredictsTheFlopsOfADenseFactor) {
  GrowingSystem system = Chain(1, 4);
  for (int i = 0; i < 29; ++i) {
    system.AddRow(4, 30, false);
  }
  ResumedSolver solver;
  EXPECT_NEAR(solver.PredictFlops(system.S, nullptr, {}), 120.0 * 120.0 * 120.0 / 3.0, 0.05 * 120.0 * 120.0 * 120.0 / 3.0);
  ASSERT_TRUE(Update(&solver, &system, {}, 0).ok());
  const double all = solver.work().factor_flops;
  EXPECT_EQ(solver.PredictFlops(system.S, nullptr, {30, nullptr, false}), 0.0);
  const double tail = solver.PredictFlops(system.S, nullptr, {15, nullptr, false});
  EXPECT_NEAR(tail / all, 7.0 / 8.0, 0.02);
  EXPECT_GT(solver.Bytes(), 120u * 120u / 2u * sizeof(double));
}

}  // namespace
}  // namespace inceres::internal
