#include "linear/dense_order.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "linear/dense_cholesky.h"
#include "linear/random_system.h"

namespace inceres::internal {
namespace {

// A window of VINS: poses that are all coupled, then a speed and bias each, coupled to its
// neighbors in time and to two poses; a prior couples the first of them to every pose.
std::set<std::pair<int, int>> WindowCouplings(int frames) {
  std::set<std::pair<int, int>> coupled;
  for (int i = 0; i < frames; ++i) {
    coupled.insert({frames, i});
    for (int j = 0; j < i; ++j) {
      coupled.insert({i, j});
    }
    for (int j = std::max(0, i - 1); j <= std::min(frames - 1, i + 1); ++j) {
      coupled.insert({frames + i, j});
    }
    if (i > 0) {
      coupled.insert({frames + i, frames + i - 1});
    }
  }
  return coupled;
}

std::vector<int> WindowSizes(int frames) {
  std::vector<int> sizes(frames, 6);
  sizes.resize(2 * frames, 9);
  return sizes;
}

RandomSystem Window(int frames) {
  return {WindowSizes(frames), WindowCouplings(frames)};
}

TEST(DenseOrder, IsAPermutationWithItsOffsets) {
  const RandomSystem system = Window(11);
  const DenseOrder order = OrderForEnvelope(system.pattern);
  std::vector<int> sorted = order.blocks;
  std::sort(sorted.begin(), sorted.end());
  std::vector<int> all(22);
  std::iota(all.begin(), all.end(), 0);
  EXPECT_EQ(sorted, all);
  for (int place = 0; place < 22; ++place) {
    EXPECT_EQ(order.offsets[place + 1] - order.offsets[place],
              system.pattern.block_size(order.blocks[place]));
  }
}

// Tiles of 12 rows reach beyond the rows' beginnings, but not far: the products take little more
// than the whole factorization inside the envelope.
TEST(DenseOrder, ProductsKeepToTheEnvelope) {
  const RandomSystem system = Window(11);
  const Executor executor(1);
  DenseCholesky solver(executor);
  ASSERT_TRUE(solver.Analyze(system.Matrix()).ok());
  EXPECT_LT(solver.ProductFlops(), 1.35 * solver.PredictedFlops());
}

// In the order of the pattern the speeds and biases come last and are full rows.
TEST(DenseOrder, SpeedsAndBiasesAheadOfPosesTakeAThirdOfTheFlops) {
  const RandomSystem system = Window(11);
  const double n = system.pattern.size();
  const double flops = OrderForEnvelope(system.pattern).flops;
  EXPECT_LT(flops, n * n * n / 9.0);
  EXPECT_GT(flops, n * n * n / 27.0);  // the poses alone: a fifth of the rows to the third
}

TEST(DenseOrder, AFullMatrixKeepsItsOrder) {
  const RandomSystem system({6, 9, 3, 15}, RandomSystem::Fill::kDense);
  const DenseOrder order = OrderForEnvelope(system.pattern);
  EXPECT_EQ(order.blocks, (std::vector<int>{0, 1, 2, 3}));
  const double n = system.pattern.size();
  EXPECT_NEAR(order.flops, n * n * n / 3.0, 0.2 * n * n * n / 3.0);
}

// What lies ahead of the first block of a row is zero in the factor: then nothing that is left out
// was missing.
TEST(DenseOrder, RowsOfTheFactorBeginWhereItSays) {
  for (const int frames : {2, 5, 11}) {
    const RandomSystem system = Window(frames);
    const DenseOrder order = OrderForEnvelope(system.pattern);
    const Eigen::MatrixXd S = system.Dense();
    Eigen::VectorXi rows(S.rows());
    for (std::size_t place = 0; place < order.blocks.size(); ++place) {
      for (int r = 0; r < system.pattern.block_size(order.blocks[place]); ++r) {
        rows[order.offsets[place] + r] = system.pattern.offsets[order.blocks[place]] + r;
      }
    }
    const Eigen::MatrixXd permuted = S(rows, rows);
    const Eigen::MatrixXd L = permuted.llt().matrixL();
    for (std::size_t place = 0; place < order.blocks.size(); ++place) {
      const int begin = order.offsets[order.first[place]];
      EXPECT_EQ(
          L.block(order.offsets[place], 0, order.offsets[place + 1] - order.offsets[place], begin)
              .norm(),
          0.0);
    }
  }
}

TEST(DenseOrder, DenseCholeskySolvesInIt) {
  for (const int num_threads : {1, 2}) {
    for (const int frames : {1, 3, 7, 11, 17, 60}) {  // both widths of a panel
      const RandomSystem system = Window(frames);
      const Executor executor(num_threads);
      DenseCholesky solver(executor);
      ASSERT_TRUE(solver.Analyze(system.Matrix()).ok());
      ASSERT_TRUE(solver.Factorize(system.Matrix(), {}).ok());
      const Eigen::VectorXd b = Eigen::VectorXd::LinSpaced(system.pattern.size(), -1.0, 2.0);
      Eigen::VectorXd x(b.size());
      ASSERT_TRUE(solver.Solve(b.data(), {}, {}, x.data()).ok());
      EXPECT_LT((system.Dense() * x - b).norm(), 1e-13 * b.norm()) << frames << " frames";
    }
  }
}

TEST(DenseOrder, TheFailureIsNamedByThePatternsOwnNumber) {
  RandomSystem system = Window(11);
  const Executor executor(1);
  DenseCholesky solver(executor);
  ASSERT_TRUE(solver.Analyze(system.Matrix()).ok());
  const int first_eliminated = OrderForEnvelope(system.pattern).blocks.front();
  ASSERT_NE(first_eliminated, 0);
  system.Spoil(system.pattern.offsets[first_eliminated] + 2);
  const Status status = solver.Factorize(system.Matrix(), {});
  EXPECT_EQ(status.code, StatusCode::kSingular);
  EXPECT_NE(status.message.find("at frame " + std::to_string(first_eliminated)), std::string::npos)
      << status.message;
}

}  // namespace
}  // namespace inceres::internal
