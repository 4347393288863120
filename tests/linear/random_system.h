#pragma once

#include <set>
#include <type_traits>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "inceres/linear/reduced_solver.h"
#include "support/core_pipeline.h"
#include "support/random_values.h"

namespace inceres::internal {

/// A random symmetric positive definite block matrix S + diag, well conditioned, in a pattern of
/// its own.
struct RandomSystem {
  enum class Fill { kDense, kBand, kDiagonal };

  /// Blocks of `sizes`. kBand has the blocks beside the diagonal, some at distance five, and a last
  /// row that is full.
  RandomSystem(const std::vector<int>& sizes, Fill fill, unsigned seed = 1)
      : RandomSystem(
            sizes,
            [fill, n = static_cast<int>(sizes.size())](int i, int j) {
              const bool near = i - j <= 1 || (i - j == 5 && i % 3 == 0) || i == n - 1;
              return fill == Fill::kDense || (fill == Fill::kBand && near);
            },
            seed) {}

  /// With the blocks (row, column < row) of `coupled`, and the diagonal.
  RandomSystem(const std::vector<int>& sizes, const std::set<std::pair<int, int>>& coupled,
               unsigned seed = 1)
      : RandomSystem(
            sizes,
            [&coupled](int i, int j) {
              return coupled.count({i, j}) > 0;
            },
            seed) {}

  template <typename HasBlock,
            typename = std::enable_if_t<std::is_invocable_r_v<bool, HasBlock, int, int>>>
  RandomSystem(const std::vector<int>& sizes, const HasBlock& has_block, unsigned seed)
      : random(seed) {
    const int n = static_cast<int>(sizes.size());
    pattern.offsets = {0};
    pattern.row_begin = {0};
    pattern.value_begin = {0};
    for (int i = 0; i < n; ++i) {
      pattern.offsets.push_back(pattern.offsets.back() + sizes[static_cast<std::size_t>(i)]);
      for (int j = 0; j <= i; ++j) {
        if (i == j || has_block(i, j)) {
          pattern.columns.push_back(j);
          pattern.value_begin.push_back(pattern.value_begin.back() +
                                        std::int64_t{sizes[static_cast<std::size_t>(i)]} *
                                            sizes[static_cast<std::size_t>(j)]);
        }
      }
      pattern.row_begin.push_back(static_cast<int>(pattern.columns.size()));
    }
    FillValues();
  }

  // Off-diagonal entries in [-1, 1); diagonal blocks symmetric and dominant.
  void FillValues() {
    values = random.Vector(static_cast<std::size_t>(pattern.value_begin.back()));
    diagonal.assign(static_cast<std::size_t>(pattern.size()), 0.0);
    for (int i = 0; i < pattern.num_blocks(); ++i) {
      const auto r = static_cast<std::size_t>(i);
      const int size = pattern.block_size(i);
      double* block = values.data() +
                      pattern.value_begin[static_cast<std::size_t>(pattern.row_begin[r + 1]) - 1];
      for (int a = 0; a < size; ++a) {
        for (int b = 0; b < a; ++b) {
          block[b * size + a] = block[a * size + b];
        }
        block[a * size + a] = pattern.size();
        diagonal[static_cast<std::size_t>(pattern.offsets[r] + a)] = random.Between(0.0, 1.0);
      }
    }
  }

  Eigen::MatrixXd Dense() const {
    Eigen::MatrixXd S = test::ToDense(pattern, values.data());
    S.diagonal() += Eigen::Map<const Eigen::VectorXd>(diagonal.data(), pattern.size());
    return S;
  }

  // (S + diag) x
  Eigen::VectorXd Times(const Eigen::VectorXd& x) const {
    using Block =
        Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>;
    Eigen::VectorXd product =
        Eigen::Map<const Eigen::VectorXd>(diagonal.data(), pattern.size()).cwiseProduct(x);
    Matrix().ForEachBlock([&](int i, int j, const double* values_of_block, int /*stride*/) {
      const int rows = pattern.block_size(i), columns = pattern.block_size(j);
      const int at = pattern.offsets[static_cast<std::size_t>(i)];
      const int column = pattern.offsets[static_cast<std::size_t>(j)];
      const Block block(values_of_block, rows, columns);
      product.segment(at, rows) += block * x.segment(column, columns);
      if (i != j) {
        product.segment(column, columns) += block.transpose() * x.segment(at, rows);
      }
    });
    return product;
  }

  ReducedMatrix Matrix() const { return {pattern, values.data(), diagonal.data()}; }

  // Makes the matrix indefinite at scalar row `at`.
  void Spoil(int at) { diagonal[static_cast<std::size_t>(at)] = -1e6; }

  test::Random random;
  BlockPattern pattern;
  std::vector<double> values;
  std::vector<double> diagonal;
};

}  // namespace inceres::internal
