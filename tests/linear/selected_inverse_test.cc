#include "linear/selected_inverse.h"

#include <vector>

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include "linear/random_system.h"
#include "support/dense_oracle.h"

namespace inceres::internal {
namespace {

using Eigen::MatrixXd;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// A path with loops and blocks of several sizes: subtrees beside each other, fronts of many widths.
RandomSystem PathOfManySizes(int num_frames, unsigned seed) {
  std::vector<int> sizes;
  for (int i = 0; i < num_frames; ++i) {
    sizes.push_back(1 + (i * 7 + static_cast<int>(seed)) % 9);
  }
  return {
      sizes,
      [](int i, int j) { return i - j <= 4 || (i % 30 == 0 && j % 30 == 0 && (i - j) % 90 == 0); },
      seed};
}

// Every block that is there, in both orders, against the dense inverse. How many are there.
int ExpectInverse(const RandomSystem& system, const SelectedInverse& selected) {
  const MatrixXd inverse = system.Dense().inverse();
  const BlockPattern& pattern = system.pattern;
  int count = 0;
  for (int i = 0; i < pattern.num_blocks(); ++i) {
    for (int j = 0; j < pattern.num_blocks(); ++j) {
      EXPECT_EQ(selected.Has(i, j), selected.Has(j, i));
      if (!selected.Has(i, j)) {
        continue;
      }
      ++count;
      RowMajor block(pattern.block_size(i), pattern.block_size(j));
      selected.Block(i, j, block.data());
      const MatrixXd expected =
          inverse.block(pattern.offsets[i], pattern.offsets[j], block.rows(), block.cols());
      EXPECT_LT((block - expected).norm(), 1e-12 * inverse.diagonal().maxCoeff()) << i << ", " << j;
      for (int k = 0; i == j && k < pattern.block_size(i); ++k) {
        EXPECT_EQ(selected.Diagonal(i, k), block(k, k));
      }
    }
  }
  return count;
}

TEST(SelectedInverse, HasTheBlocksOfTheFactor) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    const RandomSystem system = PathOfManySizes(40 * static_cast<int>(seed), seed);
    const Executor executor(1);
    SparseCholesky factor(executor);
    const ReducedMatrix A(system.pattern, system.values.data(), system.diagonal.data());
    ASSERT_TRUE(factor.Analyze(A).ok());
    ASSERT_TRUE(factor.Factorize(A, {}).ok());
    const SelectedInverse selected(factor, system.pattern, executor);
    const int count = ExpectInverse(system, selected);
    EXPECT_LT(count, system.pattern.num_blocks() * system.pattern.num_blocks() / 2 + 900);
    for (int i = 0; i < system.pattern.num_blocks(); ++i) {  // all blocks of A are among them
      for (int k = system.pattern.row_begin[i]; k < system.pattern.row_begin[i + 1]; ++k) {
        EXPECT_TRUE(selected.Has(i, system.pattern.columns[k]));
      }
    }
  }
}

TEST(SelectedInverse, OfADenseMatrixIsTheWholeInverse) {
  const RandomSystem system({6, 3, 9, 1, 6, 6, 15}, RandomSystem::Fill::kDense, 3);
  const Executor executor(1);
  SparseCholesky factor(executor);
  const ReducedMatrix A(system.pattern, system.values.data(), system.diagonal.data());
  ASSERT_TRUE(factor.Analyze(A).ok());
  ASSERT_TRUE(factor.Factorize(A, {}).ok());
  EXPECT_EQ(ExpectInverse(system, SelectedInverse(factor, system.pattern, executor)), 49);
}

TEST(SelectedInverse, HasTheSameBitsForAnyNumberOfThreads) {
  // Fronts large enough to be cut into tasks.
  const RandomSystem system(std::vector<int>(70, 6), RandomSystem::Fill::kDense, 5);
  std::vector<double> blocks[2];
  for (const int num_threads : {1, 4}) {
    const Executor executor(num_threads);
    SparseCholesky factor(executor);
    const ReducedMatrix A(system.pattern, system.values.data(), system.diagonal.data());
    ASSERT_TRUE(factor.Analyze(A).ok());
    ASSERT_TRUE(factor.Factorize(A, {}).ok());
    const SelectedInverse selected(factor, system.pattern, executor);
    for (int i = 0; i < 70; ++i) {
      std::vector<double> block(36);
      selected.Block(i, (i * 13) % 70, block.data());
      std::vector<double>& all = blocks[num_threads / 4];
      all.insert(all.end(), block.begin(), block.end());
    }
  }
  EXPECT_EQ(blocks[0], blocks[1]);
}

}  // namespace
}  // namespace inceres::internal
