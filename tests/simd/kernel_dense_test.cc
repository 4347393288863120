// The kernels of dense matrices on odd sizes and strides; what lies outside the given rows stays as
// it was.
#include "simd/kernel_fixture.h"

namespace inceres::internal {
namespace {

// A column-major matrix with a stride longer than its columns.
struct Matrix {
  Matrix(int num_rows, int num_columns, test::Random* random)
      : rows(num_rows),
        columns(num_columns),
        stride(num_rows + 3),
        values(random->Vector(static_cast<std::size_t>((num_rows + 3) * num_columns))) {}
  double& operator()(int r, int c) { return values[static_cast<std::size_t>(c * stride + r)]; }
  double operator()(int r, int c) const { return values[static_cast<std::size_t>(c * stride + r)]; }
  int rows;
  int columns;
  int stride;
  std::vector<double> values;
};

class DenseKernels : public KernelTest {
 protected:
  void ExpectOuterSubtracted(int rows, int cols, int depth) {
    const Matrix A(rows, depth, &random_);
    const Matrix B(cols, depth, &random_);
    const Matrix start(rows, cols, &random_);
    Matrix expected = start;
    for (int c = 0; c < cols; ++c) {
      for (int r = 0; r < rows; ++r) {
        double sum = 0.0;
        for (int k = 0; k < depth; ++k) {
          sum += A(r, k) * B(c, k);
        }
        expected(r, c) -= sum;
      }
    }
    Matrix C = start;
    kernels().subtract_outer(rows, cols, depth, A.values.data(), A.stride, B.values.data(),
                             B.stride, C.values.data(), C.stride);
    ExpectClose(
        C.values, expected.values, 1.0 + depth, 1e-13,
        std::to_string(rows) + " x " + std::to_string(cols) + ", depth " + std::to_string(depth));
  }
};

TEST_P(DenseKernels, SubtractOuterForOddSizes) {
  for (const int rows : {0, 1, 2, 3, 4, 5, 7, 11, 12, 13, 16, 23, 25, 97}) {
    for (const int cols : {1, 2, 3, 4, 5, 7, 15, 16}) {
      for (const int depth : {0, 1, 2, 5, 16, 33}) {
        ExpectOuterSubtracted(rows, cols, depth);
        if (HasFatalFailure()) {
          return;
        }
      }
    }
  }
}

TEST_P(DenseKernels, SubtractOuterDeeperThanASlice) {
  for (const int depth : {191, 192, 193, 400}) {
    ExpectOuterSubtracted(29, 13, depth);
  }
}

// Cutting the rows into strips of 96 must not change a bit: that is what makes the factor
// independent of the thread count.
TEST_P(DenseKernels, SubtractOuterByStripsGivesTheSameBits) {
  const int rows = 301;
  const Matrix A(rows, 40, &random_);
  const Matrix B(16, 40, &random_);
  Matrix whole(rows, 16, &random_);
  Matrix strips = whole;
  kernels().subtract_outer(rows, 16, 40, A.values.data(), A.stride, B.values.data(), B.stride,
                           whole.values.data(), whole.stride);
  for (int top = 0; top < rows; top += 96) {
    kernels().subtract_outer(std::min(96, rows - top), 16, 40, A.values.data() + top, A.stride,
                             B.values.data(), B.stride, strips.values.data() + top, strips.stride);
  }
  EXPECT_EQ(whole.values, strips.values);
}

// On and below the diagonal the bits are those of the whole product; nothing outside C is written.
TEST_P(DenseKernels, SubtractLowerOuterGivesTheBitsOfTheWholeProduct) {
  for (const int rows : {1, 3, 4, 6, 8, 12, 13, 20, 24, 29, 97}) {
    for (const int cols : {1, 2, 3, 4, 6, 9, 20, 24}) {
      for (const int depth : {0, 1, 3, 4, 5, 20, 193}) {
        if (cols > rows) {
          continue;
        }
        const Matrix A(rows, depth, &random_);
        const Matrix start(rows, cols, &random_);
        Matrix whole = start, lower = start;
        kernels().subtract_outer(rows, cols, depth, A.values.data(), A.stride, A.values.data(),
                                 A.stride, whole.values.data(), whole.stride);
        small_kernels().subtract_lower_outer(rows, cols, depth, A.values.data(), A.stride,
                                             lower.values.data(), lower.stride);
        for (int c = 0; c < cols; ++c) {
          for (int r = 0; r < lower.stride; ++r) {
            const double expected = r < rows ? whole(r, c) : start(r, c);
            ASSERT_TRUE(r < c || lower(r, c) == expected)
                << rows << " x " << cols << ", depth " << depth << ", at " << r << ", " << c;
          }
        }
      }
    }
  }
}

TEST_P(DenseKernels, SolveLowerTransposedForOddSizes) {
  for (const int rows : {0, 1, 2, 3, 4, 5, 11, 12, 13, 31}) {
    for (const int size : {1, 2, 3, 4, 5, 15, 16, 17}) {
      Matrix L(size, size, &random_);
      for (int j = 0; j < size; ++j) {
        L(j, j) = random_.Between(2.0, 3.0);
        for (int i = j + 1; i < size; ++i) {
          L(i, j) /= size;  // keeps the growth of the solution small
        }
      }
      const Matrix right(rows, size, &random_);
      Matrix X = right;
      kernels().solve_lower_transposed(rows, size, L.values.data(), L.stride, X.values.data(),
                                       X.stride);
      Matrix product = X;  // X Lᵀ must give the right-hand side back; entries between columns stay
      for (int r = 0; r < rows; ++r) {
        for (int c = 0; c < size; ++c) {
          product(r, c) = 0.0;
          for (int k = 0; k <= c; ++k) {
            product(r, c) += X(r, k) * L(c, k);
          }
        }
      }
      ExpectClose(product.values, right.values, size, 1e-13,
                  std::to_string(rows) + " rows, size " + std::to_string(size));
      if (HasFatalFailure()) {
        return;
      }
    }
  }
}

// Row-major A Bᵀ is what the column-major Matrix gives when its columns are read as rows.
TEST_P(DenseKernels, SubtractRowDotsForOddSizes) {
  for (const int rows : {0, 1, 2, 3, 4, 6, 7, 9}) {
    for (const int cols : {1, 2, 3, 5, 6, 9}) {
      for (const int depth : {0, 1, 3, 4, 5, 8, 31}) {
        const Matrix A(depth, rows, &random_);
        const Matrix B(depth, cols, &random_);
        Matrix C(cols, rows, &random_);
        Matrix expected = C;
        for (int r = 0; r < rows; ++r) {
          for (int c = 0; c < cols; ++c) {
            double sum = 0.0;
            for (int k = 0; k < depth; ++k) {
              sum += A(k, r) * B(k, c);
            }
            expected(c, r) -= sum;
          }
        }
        kernels().subtract_row_dots(rows, cols, depth, A.values.data(), A.stride, B.values.data(),
                                    B.stride, C.values.data(), C.stride);
        ExpectClose(C.values, expected.values, 1.0 + depth, 1e-13,
                    std::to_string(rows) + " x " + std::to_string(cols) + ", depth " +
                        std::to_string(depth));
      }
    }
  }
}

TEST_P(DenseKernels, RowsToColumnsForOddSizes) {
  for (const int rows : {0, 1, 3, 4, 5, 8, 53}) {
    for (const int columns : {1, 2, 3, 4, 7, 16}) {
      const Matrix J(columns, rows, &random_);  // its columns read as rows
      Matrix actual(rows, columns, &random_);
      Matrix expected = actual;
      for (int r = 0; r < rows; ++r) {
        for (int c = 0; c < columns; ++c) {
          expected(r, c) = J(c, r);
        }
      }
      kernels().rows_to_columns(rows, columns, J.values.data(), J.stride, actual.values.data(),
                                actual.stride);
      EXPECT_EQ(actual.values, expected.values) << rows << " x " << columns;
    }
  }
}

TEST_P(DenseKernels, ColumnProductsForOddSizes) {
  for (const int rows : {0, 4, 12, 16, 20, 56}) {
    for (const int columns : {1, 2, 3, 5, 16}) {
      const Matrix J_f(rows, columns + 1, &random_);
      const std::vector<double> v = random_.Vector(static_cast<std::size_t>(columns));
      RowProducts expected;
      for (int r = 0; r < rows; ++r) {
        double Jv = 0.0;
        for (int c = 0; c < columns; ++c) {
          Jv += J_f(r, c) * v[static_cast<std::size_t>(c)];
        }
        expected.model_decrease -= Jv * (J_f(r, columns) + 0.5 * Jv);
        expected.squared_norm += Jv * Jv;
      }
      const RowProducts actual =
          kernels().column_products(rows, columns, J_f.values.data(), J_f.stride, v.data());
      const double tolerance = 1e-13 * (1.0 + rows * columns);
      EXPECT_NEAR(actual.model_decrease, expected.model_decrease, tolerance)
          << rows << " x " << columns;
      EXPECT_NEAR(actual.squared_norm, expected.squared_norm, tolerance)
          << rows << " x " << columns;
    }
  }
}

INCERES_FOR_ALL_INSTRUCTION_SETS(DenseKernels);

}  // namespace
}  // namespace inceres::internal
