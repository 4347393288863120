// The resumed factor and substitutions: without truncation the same bits as from scratch, with it
// an error that stays bounded, and in either case no work on rows that nothing reaches.
#include "linear/resumed_solver.h"

#include <cmath>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "linear/growing_system.h"
#include "support/dense_oracle.h"

namespace inceres::internal {
namespace {

constexpr ReducedSolver::Truncation kExact;

Status Update(ReducedSolver* solver, GrowingSystem* system, const ReducedSolver::Rows& changed,
              int first_b, const ReducedSolver::Truncation& truncation = kExact) {
  const Status status = system->Factorize(changed, solver);
  return status.ok() ? system->Solve({first_b}, truncation, solver) : status;
}

// In the order that the solver has come to.
std::vector<double> FromScratch(const GrowingSystem& system, const RowOrder& order) {
  const auto permute = [&](const std::vector<double>& from, bool to_places) {
    std::vector<double> to(from.size());
    int at = 0;
    for (const int row : order.rows()) {
      const int offset = system.OffsetOf(row);
      for (int k = 0; k < system.S.size_of(row); ++k, ++at) {
        to[static_cast<std::size_t>(to_places ? at : offset + k)] =
            from[static_cast<std::size_t>(to_places ? offset + k : at)];
      }
    }
    return to;
  };
  EnvelopeCholesky cholesky;
  EXPECT_TRUE(cholesky.Factorize(system.S, order, permute(system.damping, true).data(), 0,
                                 system.held.data()));
  std::vector<double> x(system.b.size());
  cholesky.Solve(permute(system.b, true).data(), x.data());
  return permute(x, false);
}

GrowingSystem Chain(int length, int size = 6) {
  GrowingSystem system(1);
  for (int i = 0; i < length; ++i) {
    system.AddRow(size, 2, false);
  }
  return system;
}

// Whether each factorization is solved with, or every fifth.
TEST(ResumedSolver, SameBitsAsFromScratchUnderRandomChanges) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    GrowingSystem system(seed);
    ResumedSolver solver;
    int first_b = 0;
    for (int step = 0; step < 60; ++step) {
      const RandomChange edit(&system, /*may_hold=*/true);
      first_b = std::min(first_b, edit.first_b);
      ASSERT_TRUE(system.Factorize(edit.change, &solver).ok());
      if (seed % 4 < 3 || step % 5 == 4) {
        ASSERT_TRUE(system.Solve({first_b}, kExact, &solver).ok());
        ASSERT_EQ(system.x, FromScratch(system, solver.order()))
            << "seed " << seed << ", step " << step;
        first_b = system.num_rows();
      }
    }
    const Eigen::VectorXd expected = system.Dense().llt().solve(system.FreeB());
    EXPECT_LE((system.X() - expected).norm(), 1e-12 * expected.norm());
  }
}

TEST(ResumedSolver, AnAppendedRowTouchesTheTailOnly) {
  GrowingSystem system = Chain(500);
  ResumedSolver solver;
  ASSERT_TRUE(Update(&solver, &system, {}, 0).ok());
  EXPECT_EQ(solver.work().factored_rows, 500);
  EXPECT_EQ(solver.work().solved.first_row, 0);
  system.AddRow(6, 2, false);
  ASSERT_TRUE(Update(&solver, &system, {500, nullptr}, 500, {system.damping.data(), 1e-14}).ok());
  EXPECT_EQ(solver.work().factored_rows, 1);
  EXPECT_EQ(solver.work().forward_rows, 1);
  EXPECT_LT(solver.work().solved_rows, 20);
  EXPECT_EQ(solver.work().solved.first_row, 501 - solver.work().solved_rows);
  EXPECT_LT(solver.work().factor_flops, 6000.0);
}

TEST(ResumedSolver, NothingChangedIsNothingDone) {
  GrowingSystem system = Chain(50);
  ResumedSolver solver;
  ASSERT_TRUE(Update(&solver, &system, {}, 0).ok());
  const std::vector<double> before = system.x;
  ASSERT_TRUE(Update(&solver, &system, {50, nullptr}, 50).ok());
  EXPECT_EQ(solver.work().factored_rows, 0);
  EXPECT_EQ(solver.work().solved_rows, 0);
  EXPECT_EQ(system.x, before);
}

// A change far down the rows is stopped by the threshold; one that reaches a far row by a loop goes
// there.
TEST(ResumedSolver, ALoopCarriesTheChangeToItsEnd) {
  GrowingSystem system = Chain(300);
  system.Couple(299, 100);
  ResumedSolver solver;
  const ReducedSolver::Truncation truncation{system.damping.data(), 1e-16};
  ASSERT_TRUE(Update(&solver, &system, {}, 0, truncation).ok());
  system.Perturb(299);
  ASSERT_TRUE(Update(&solver, &system, {299, nullptr}, 300, truncation).ok());
  EXPECT_EQ(solver.work().factored_rows, 1);
  EXPECT_LE(solver.work().solved.first_row, 100);
  EXPECT_GT(solver.work().solved.first_row, 70);
}

// Many steps, each of which truncates: the error does not add up. Weights 1: the bound on a row's
// change is sqrt(threshold).
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
    ASSERT_TRUE(
        Update(&solver, &system, {step == 0 ? 0 : row, nullptr}, row, {weights.data(), kThreshold})
            .ok());
    left_out += solver.work().solved.first_row > 0;
    const Eigen::VectorXd expected = system.Dense().llt().solve(system.FreeB());
    ASSERT_LE((system.X() - expected).lpNorm<Eigen::Infinity>(), 2.0 * std::sqrt(kThreshold))
        << step;
  }
  EXPECT_GT(left_out, 390);
}

// The caller applies a part of the solution: b and x follow there, and the rest is still the
// solution.
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
  ASSERT_TRUE(Update(&solver, &system, {60, nullptr}, 48, {weights.data(), 1e-20}).ok());
  EXPECT_GT(solver.work().solved.first_row, 20);
  EXPECT_LE((system.X() - system.Dense().llt().solve(b)).lpNorm<Eigen::Infinity>(), 1e-9);
}

// Another solver had the last b and wrote x.
TEST(ResumedSolver, CatchesUpWithASolveItMissed) {
  GrowingSystem system = Chain(30);
  ResumedSolver solver;
  ASSERT_TRUE(Update(&solver, &system, {}, 0).ok());
  system.b[static_cast<std::size_t>(system.OffsetOf(20))] += 1.0;
  solver.MissSolve({20});
  std::fill(system.x.begin(), system.x.end(), 77.0);
  ASSERT_TRUE(solver.Solve(system.b.data(), {30}, kExact, system.x.data()).ok());
  EXPECT_EQ(system.x, FromScratch(system, solver.order()));
}

// Against a count of the multiplications and additions of a textbook factorization inside the
// envelope.
TEST(ResumedSolver, PredictsTheFlopsOfADenseFactor) {
  GrowingSystem system = Chain(1, 4);
  for (int i = 0; i < 29; ++i) {
    system.AddRow(4, 30, false);
  }
  ResumedSolver solver;
  EXPECT_NEAR(solver.PlanFor(system.Matrix(), {}).flops, 120.0 * 120.0 * 120.0 / 3.0,
              0.05 * 120.0 * 120.0 * 120.0 / 3.0);
  ASSERT_TRUE(Update(&solver, &system, {}, 0).ok());
  const double all = solver.work().factor_flops;
  EXPECT_EQ(solver.PlanFor(system.Matrix(), {30, nullptr}).flops, 0.0);
  const double tail = solver.PlanFor(system.Matrix(), {15, nullptr}).flops;
  EXPECT_NEAR(tail / all, 7.0 / 8.0, 0.02);
  EXPECT_GT(solver.Bytes(), 120u * 120u / 2u * sizeof(double));
}

// A way there and back, with few landmarks in common between: what the loops of a long path do to
// the order of arrival.
class AgedOrder : public testing::Test {
 protected:
  static constexpr int kTurn = 150;
  static constexpr int kBand = 4;

  // One frame more; it sees those of the way there where it passes them, and they change with it.
  void Arrive() {
    const int row = system_.num_rows();
    system_.AddRow(6, kBand, false);
    rows_ = {row};
    for (int near = 1; near <= kBand && near <= row; ++near) {
      rows_.push_back(row - near);
    }
    for (int old = 2 * kTurn - row;
         row > kTurn + kBand && old > 2 * kTurn - row - kBand && old >= 0; --old) {
      system_.Couple(row, old);
      rows_.push_back(old);
    }
    for (const int changed : rows_) {
      if (system_.S.size_of(changed) > 0) {
        system_.Perturb(changed);
      }
    }
    Follow();
  }

  // The rows changed are rows_; b anew in them.
  void Follow() {
    std::sort(rows_.begin(), rows_.end());
    for (const int row : rows_) {
      for (int k = 0; k < system_.S.size_of(row); ++k) {
        system_.b[static_cast<std::size_t>(system_.OffsetOf(row) + k)] = system_.random.Unit();
      }
    }
    const ReducedSolver::Rows changed{rows_.front(), &rows_};
    ASSERT_TRUE(system_.Factorize(changed, &solver_).ok());
    reorderings_ += solver_.work().reorderings;
    flops_ += solver_.work().factor_flops;
    arrival_flops_ += EnvelopeFlops(system_.S, system_.held.data(), arrival_, ArrivalPlace());
    ASSERT_TRUE(system_.Solve(changed, {system_.damping.data(), 1e-24}, &solver_).ok());
  }

  int ArrivalPlace() {
    arrival_ = ArrivalOrder(system_.S);
    int first = arrival_.num_places();
    for (const int row : rows_) {
      first = arrival_.place(row) < 0 ? 0 : std::min(first, arrival_.place(row));
    }
    return first;
  }

  void ExpectSolved() const {
    const Eigen::VectorXd expected = system_.Dense().llt().solve(system_.FreeB());
    EXPECT_LE(test::RelativeError(system_.X(), expected), 1e-10) << system_.num_rows() << " rows";
  }

  GrowingSystem system_{1};
  ResumedSolver solver_;
  RowOrder arrival_;
  std::vector<int> rows_;
  int reorderings_ = 0;
  double flops_ = 0.0;
  double arrival_flops_ = 0.0;
};

TEST_F(AgedOrder, IsRenewedNowAndThen) {
  while (system_.num_rows() < kTurn + kBand) {
    Arrive();
  }
  EXPECT_EQ(reorderings_, 0);
  EXPECT_EQ(flops_, arrival_flops_);
  while (system_.num_rows() < 2 * kTurn) {
    Arrive();
    if (system_.num_rows() % 15 == 0) {
      ExpectSolved();
    }
  }
  EXPECT_GE(reorderings_, 1);
  EXPECT_LE(reorderings_, kTurn / 5);
  EXPECT_LT(flops_, 0.3 * arrival_flops_);
  // The envelope is smaller.
  EXPECT_LT(EnvelopeFlops(system_.S, nullptr, solver_.order(), 0),
            0.3 * EnvelopeFlops(system_.S, nullptr, arrival_, 0));
}

TEST_F(AgedOrder, SurvivesRemovalsAndHeldRows) {
  while (system_.num_rows() < 2 * kTurn) {
    Arrive();
    const int row = system_.num_rows() - 1;
    if (row > kTurn && row % 3 == 0) {
      const int gone = (7 * row) % kTurn;
      if (system_.S.size_of(gone) > 0) {
        system_.RemoveRow(gone);
        rows_ = {gone};
        Follow();
        EXPECT_EQ(solver_.order().place(gone), -1);
      }
      const int held = (11 * row) % kTurn;
      system_.held[static_cast<std::size_t>(held)] ^= 1;
      rows_ = {held};
      Follow();
    }
    if (row % 15 == 0) {
      ExpectSolved();
    }
  }
  EXPECT_GE(reorderings_, 1);
  std::vector<int> living;
  for (int row = 0; row < system_.num_rows(); ++row) {
    if (system_.S.size_of(row) > 0) {
      living.push_back(row);
    }
  }
  std::vector<int> placed = solver_.order().rows();
  std::sort(placed.begin(), placed.end());
  EXPECT_EQ(placed, living);
}

}  // namespace
}  // namespace inceres::internal
