// The Cholesky factor that resumes, by itself: its resumed bits are ResumedSolver's.

#include "linear/envelope_cholesky.h"

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "linear/growing_system.h"
#include "support/dense_oracle.h"

namespace inceres::internal {
namespace {

void ExpectSolves(const EnvelopeCholesky& cholesky, GrowingSystem* system) {
  cholesky.Solve(system->b.data(), system->x.data());
  EXPECT_LE(test::RelativeError(system->X(), system->Dense().llt().solve(system->FreeB())), 1e-12);
}

TEST(EnvelopeCholesky, SolvesLikeTheDenseOracle) {
  for (const int num_rows : {1, 2, 7, 40}) {
    GrowingSystem system(static_cast<unsigned>(num_rows));
    for (int i = 0; i < num_rows; ++i) {
      system.AddRow(1 + i * 5 % 9, 3, i % 6 == 5);
    }
    EnvelopeCholesky cholesky;
    ASSERT_TRUE(cholesky.Factorize(system.S, ArrivalOrder(system.S), system.damping.data(), 0));
    ExpectSolves(cholesky, &system);
  }
}

TEST(EnvelopeCholesky, ALoopLengthensOnlyItsOwnRow) {
  std::vector<int> first[2];  // columns
  for (const bool has_loop : {false, true}) {
    GrowingSystem system(1);
    for (int i = 0; i < 100; ++i) {
      system.AddRow(6, 2, false);
    }
    if (has_loop) {
      system.Couple(60, 0);
    }
    EnvelopeCholesky cholesky;
    ASSERT_TRUE(cholesky.Factorize(system.S, ArrivalOrder(system.S), system.damping.data(), 0));
    for (int i = 0; i < 100; ++i) {
      first[has_loop ? 1 : 0].push_back(cholesky.FirstColumn(i));
    }
  }
  for (std::size_t i = 0; i < 100; ++i) {
    EXPECT_EQ(first[1][i], i == 60 ? 0 : first[0][i]);
  }
}

TEST(EnvelopeCholesky, NamesTheSingularRowAndRecovers) {
  GrowingSystem system(5);
  for (int i = 0; i < 12; ++i) {
    system.AddRow(3, 2, false);
  }
  EnvelopeCholesky cholesky;
  system.damping[24] = -1000.0;
  EXPECT_FALSE(cholesky.Factorize(system.S, ArrivalOrder(system.S), system.damping.data(), 0));
  EXPECT_EQ(cholesky.num_valid_rows(), 8);
  system.damping[24] = 0.25;
  ASSERT_TRUE(cholesky.Factorize(system.S, ArrivalOrder(system.S), system.damping.data(), 8));
  ExpectSolves(cholesky, &system);
}

}  // namespace
}  // namespace inceres::internal
