// What RankReport says was sent: nothing to oneself, and messages apart from reductions.
#include <climits>
#include <vector>

#include <gtest/gtest.h>

#include "distributed/communicator.h"
#include "inceres/distributed/distributed_solver.h"
#include "tests/distributed/parts.h"

namespace inceres::test {
namespace {

DistributedSummary SolveStreet(DistributedLinearSolver linear_solver, PreconditionerKind kind) {
  BalProblem bal;
  const Status status = ReadBal(INCERES_SOURCE_DIR "/bal_data/street-16-1200-pre.txt", &bal);
  EXPECT_TRUE(status.ok()) << status.message;
  DistributedOptions options;
  options.linear_solver = linear_solver;
  options.solver.conjugate_gradients.preconditioner = kind;
  options.solver.max_num_iterations = 3;
  BalPart part(bal);
  return DistributedSolver(MPI_COMM_WORLD, options).Solve(part.part());
}

// A rank that is alone sends nothing, whatever it does.
TEST(Traffic, NothingGoesToOneself) {
  if (NumRanks() > 1) {
    return;
  }
  for (const auto linear_solver :
       {DistributedLinearSolver::kCholesky, DistributedLinearSolver::kConjugateGradients}) {
    const RankReport report = SolveStreet(linear_solver, PreconditionerKind::kTwoLevel).ranks[0];
    EXPECT_EQ(report.bytes_sent, 0);
    EXPECT_EQ(report.reduction_bytes_sent, 0);
  }
}

// Sums of numbers go to all other ranks, blocks of S and rows of a coarse basis to one: a rank of
// the former sends as much as any other, of the latter as much as it has.
TEST(Traffic, ReductionsAreTheSameOnAllRanksAndMessagesAreNot) {
  if (NumRanks() < 3) {
    return;
  }
  for (const auto linear_solver :
       {DistributedLinearSolver::kCholesky, DistributedLinearSolver::kConjugateGradients}) {
    const std::vector<RankReport> ranks =
        SolveStreet(linear_solver, PreconditionerKind::kSchurJacobi).ranks;
    bool differ = false;
    for (const RankReport& report : ranks) {
      EXPECT_EQ(report.reduction_bytes_sent, ranks[0].reduction_bytes_sent);
      EXPECT_GT(report.bytes_sent, report.reduction_bytes_sent);
      differ = differ || report.bytes_sent != ranks[0].bytes_sent;
    }
    EXPECT_TRUE(differ);
  }
}

// Counts of all ranks together may be more than the ints that the summary has for them.
TEST(Counts, AreAtMostTheLargestInt) {
  EXPECT_EQ(internal::SaturatedCount(0.0), 0);
  EXPECT_EQ(internal::SaturatedCount(INT_MAX - 1.0), INT_MAX - 1);
  EXPECT_EQ(internal::SaturatedCount(INT_MAX + 1.0), INT_MAX);
  EXPECT_EQ(internal::SaturatedCount(1e12), INT_MAX);
}

}  // namespace
}  // namespace inceres::test
