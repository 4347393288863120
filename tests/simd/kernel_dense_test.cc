// The kernels of dense matrices on odd sizes and strides; what lies outside the given rows stays as
// it was.
#include <algorithm>
#include <cmath>
#include <utility>

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
  for (const int rows : {0, 1, 2, 3, 4, 5, 7, 11, 12, 13, 16, 20, 23, 25, 44, 97}) {
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

// Lanes are entries of their own: a factor has the bits of AVX2 where registers are twice as long.
TEST(LongerRegisters, GiveTheBitsOfShorterOnes) {
  const Kernels* const longer = KernelsFor(InstructionSet::kAvx512);
  const Kernels* const shorter = KernelsFor(InstructionSet::kAvx2);
  if (longer == nullptr || shorter == nullptr) {
    GTEST_SKIP() << "the processor has no AVX-512";
  }
  test::Random random{12345};
  for (const int rows : {4, 12, 20, 36, 44, 96, 101}) {
    const Matrix A(rows, 200, &random);
    const Matrix B(17, 200, &random);
    Matrix L(17, 17, &random);
    for (int j = 0; j < 17; ++j) {
      L(j, j) = 2.0;
    }
    Matrix longs(rows, 17, &random);
    Matrix shorts = longs;
    for (auto [set, X] : {std::pair(longer, &longs), std::pair(shorter, &shorts)}) {
      set->subtract_outer(rows, 17, 200, A.values.data(), A.stride, B.values.data(), B.stride,
                          X->values.data(), X->stride);
      set->solve_lower_transposed(rows, 17, L.values.data(), L.stride, X->values.data(), X->stride);
    }
    EXPECT_EQ(longs.values, shorts.values) << rows << " rows";
  }
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
        kernels().subtract_lower_outer(rows, cols, depth, A.values.data(), A.stride,
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

// A path of blocks with an anchor, and what comes after it, as a dense matrix: path, next, anchor.
class DensePath {
 public:
  DensePath(int size, int count, test::Random* random)
      : size_(size), count_(count), dense_((count + 2) * size, (count + 2) * size, random) {
    for (int c = 0; c < dense_.columns; ++c) {
      for (int r = 0; r < dense_.rows; ++r) {
        const int i = std::max(r / size, c / size), j = std::min(r / size, c / size);
        // Neighbors, and the first with the anchor; what is behind the path begins with zeros.
        const bool is_there =
            i < count ? i - j <= 1 : j < count && (i == count ? j == count - 1 : j == 0);
        dense_(r, c) = !is_there ? 0.0 : r == c ? 8.0 + size : 0.5 * random->Unit();
        if (r < c) {
          dense_(c, r) = dense_(r, c);
        }
      }
    }
  }

  AlignedVector<double> Tiles() const {
    AlignedVector<double> tiles(static_cast<std::size_t>((count_ + 1) * TileSize()), 0.0);
    for (int t = 0; t < count_; ++t) {
      for (int c = 0; c < size_; ++c) {
        for (int r = 0; r < size_; ++r) {
          Tile(&tiles, t, 0, r, c) = dense_(t * size_ + r, t * size_ + c);
          Tile(&tiles, t, 1, r, c) = dense_((count_ + 1) * size_ + r, t * size_ + c);
          Tile(&tiles, t, 2, r, c) = dense_((t + 1) * size_ + r, t * size_ + c);
        }
      }
    }
    return tiles;
  }
  double& Tile(AlignedVector<double>* tiles, int t, int section, int r, int c) const {
    return (*tiles)[static_cast<std::size_t>(t * TileSize() + (3 * c + section) * Section() + r)];
  }
  int Section() const { return PadToQuad(size_); }
  // The path's scalars eliminated one by one; L in the columns of the path.
  void Eliminate() {
    for (int k = 0; k < count_ * size_; ++k) {
      const double root = std::sqrt(dense_(k, k));
      for (int r = k; r < dense_.rows; ++r) {
        dense_(r, k) /= root;
      }
      for (int c = k + 1; c < dense_.columns; ++c) {
        for (int r = c; r < dense_.rows; ++r) {
          dense_(r, c) -= dense_(r, k) * dense_(c, k);
        }
      }
    }
  }
  double operator()(int r, int c) const { return dense_(r, c); }

 private:
  int TileSize() const { return 3 * Section() * size_; }

  int size_, count_;
  Matrix dense_;
};

TEST_P(DenseKernels, PathsAreEliminatedAsADenseMatrixIs) {
  for (const int size : {1, 2, 3, 4, 5, 6, 7, 8}) {
    const int count = 7, next = count * size, anchor = next + size;
    DensePath path(size, count, &random_);
    const int section = path.Section();
    AlignedVector<double> tiles = path.Tiles();
    AlignedVector<double> square(static_cast<std::size_t>(size * section), 0.0);
    ASSERT_EQ(kernels().eliminate_path(size, count, tiles.data(), square.data()), -1);
    path.Eliminate();
    for (int c = 0; c < size; ++c) {
      for (int r = 0; r < size; ++r) {
        EXPECT_NEAR(path.Tile(&tiles, count - 1, 2, r, c), path(next + r, next - size + c), 1e-13);
        EXPECT_NEAR(path.Tile(&tiles, count, 1, r, c), path(anchor + r, next + c), 1e-13);
        if (r >= c) {
          EXPECT_NEAR(path.Tile(&tiles, count, 0, r, c), path(next + r, next + c), 1e-13);
          EXPECT_NEAR(square[static_cast<std::size_t>(c * section + r)],
                      path(anchor + r, anchor + c), 1e-13);
        }
      }
    }
    // L y = b, then Lᵀ x = y with what is behind the path given.
    const std::vector<double> b = random_.Vector(static_cast<std::size_t>(anchor + size));
    std::vector<double> expected = b;
    AlignedVector<double> y(static_cast<std::size_t>((count + 2) * section), 0.0);
    const auto at = [&](int scalar) -> double& {
      return y[static_cast<std::size_t>(scalar / size * section + scalar % size)];
    };
    for (int k = 0; k < anchor + size; ++k) {
      at(k) = b[static_cast<std::size_t>(k)];
    }
    double* const of_anchor = y.data() + (count + 1) * section;
    kernels().solve_path_forward(size, count, tiles.data(), y.data(), of_anchor);
    for (int k = 0; k < next; ++k) {
      expected[static_cast<std::size_t>(k)] /= path(k, k);
      for (int r = k + 1; r < anchor + size; ++r) {
        expected[static_cast<std::size_t>(r)] -= path(r, k) * expected[static_cast<std::size_t>(k)];
      }
    }
    for (int k = 0; k < anchor + size; ++k) {
      EXPECT_NEAR(at(k), expected[static_cast<std::size_t>(k)], 1e-12) << size << ", " << k;
    }
    kernels().solve_path_backward(size, count, tiles.data(), of_anchor, y.data());
    for (int k = next - 1; k >= 0; --k) {
      for (int r = k + 1; r < anchor + size; ++r) {
        expected[static_cast<std::size_t>(k)] -= path(r, k) * expected[static_cast<std::size_t>(r)];
      }
      expected[static_cast<std::size_t>(k)] /= path(k, k);
      EXPECT_NEAR(at(k), expected[static_cast<std::size_t>(k)], 1e-12) << size << ", " << k;
    }
  }
}

TEST_P(DenseKernels, APathThatIsNotDefiniteNamesTheScalar) {
  for (const int size : {3, 5, 6}) {
    for (const double pivot : {-1.0, 0.0, std::nan(""), HUGE_VAL}) {
      const DensePath path(size, 4, &random_);
      AlignedVector<double> tiles = path.Tiles();
      path.Tile(&tiles, 2, 0, 1, 1) = pivot < 0.0 ? -100.0 : pivot;
      if (pivot == 0.0) {
        // A pivot of nothing that gets nothing.
        std::fill(tiles.begin(), tiles.end(), 0.0);
      }
      EXPECT_EQ(kernels().eliminate_path(size, 4, tiles.data(), nullptr),
                pivot == 0.0 ? 0 : 2 * size + 1);
    }
  }
}

// A lower triangular L of blocks, each block row from its first column on, and rows as an envelope
// factor has them: from a whole quad on. What is behind the block on the diagonal is no number.
class EnvelopeRows {
 public:
  EnvelopeRows(const EnvelopeRows&) = delete;
  EnvelopeRows& operator=(const EnvelopeRows&) = delete;
  EnvelopeRows(int size, int lead, std::vector<int> first_columns, test::Random* random)
      : size_(size), values_(first_columns.size()), pivots_(first_columns.size()) {
    // The first block is as large as `lead`, so that the others begin anywhere in a quad.
    for (int i = 0; i < static_cast<int>(first_columns.size()); ++i) {
      offsets_.push_back(offsets_.back() + (i == 0 ? lead : size));
      EnvelopeRow row;
      row.first_column = first_columns[static_cast<std::size_t>(i)];
      row.start = Offset(row.first_column) / kQuad * kQuad;
      row.stride = PadToQuad(Offset(i + 1) - row.start);
      const int height = Offset(i + 1) - Offset(i);
      AlignedVector<double>& values = values_[static_cast<std::size_t>(i)];
      values.assign(static_cast<std::size_t>(height * row.stride), std::nan(""));
      pivots_[static_cast<std::size_t>(i)].resize(static_cast<std::size_t>(height));
      row.values = values.data();
      row.inverse_pivots = pivots_[static_cast<std::size_t>(i)].data();
      rows_.push_back(row);
      for (int r = 0; r < height; ++r) {
        for (int k = row.start; k < Offset(i + 1); ++k) {
          const double entry = k == Offset(i) + r ? 3.0 + random->Unit() : random->Unit();
          At(i, r, k) = k < Offset(row.first_column) || k > Offset(i) + r ? 0.0 : entry;
        }
        rows_.back().inverse_pivots[r] = 1.0 / At(i, r, Offset(i) + r);
      }
    }
  }

  int Offset(int i) const { return offsets_[static_cast<std::size_t>(i)]; }
  double& At(int i, int r, int k) const {
    const EnvelopeRow& row = rows_[static_cast<std::size_t>(i)];
    return row.values[r * row.stride + k - row.start];
  }
  // Entry (Offset(i) + r, Offset(j) + c) of the first columns of L times its transpose.
  double Product(int i, int r, int j, int c, int columns) const {
    double sum = 0.0;
    for (int k = std::max(rows_[static_cast<std::size_t>(i)].start,
                          rows_[static_cast<std::size_t>(j)].start);
         k < columns; ++k) {
      sum += At(i, r, k) * At(j, c, k);
    }
    return sum;
  }
  int Start(int i) const { return rows_[static_cast<std::size_t>(i)].start; }
  int FirstColumn(int i) const { return rows_[static_cast<std::size_t>(i)].first_column; }
  AlignedVector<double>& Row(int i) { return values_[static_cast<std::size_t>(i)]; }
  // Row i of L Lᵀ from block column `first` on, in place of that of L.
  void MultiplyRow(int i, int first) {
    std::vector<double> products;
    for (int r = 0; r < size_; ++r) {
      for (int j = first; j <= i; ++j) {
        for (int c = 0; c < size_; ++c) {
          products.push_back(Product(i, r, j, c, Offset(j + 1)));
        }
      }
    }
    auto product = products.begin();
    for (int r = 0; r < size_; ++r) {
      for (int k = Offset(first); k < Offset(i + 1); ++k) {
        At(i, r, k) = *product++;
      }
    }
  }
  void Run(const Kernels& kernels, int i, int first, int end) const {
    kernels.solve_envelope_run(size_, rows_.data(), offsets_.data(), i, first, end);
  }

 private:
  int size_;
  std::vector<int> offsets_{0};
  std::vector<AlignedVector<double>> values_;
  std::vector<std::vector<double>> pivots_;
  std::vector<EnvelopeRow> rows_;
};

TEST_P(DenseKernels, RunsOfAnEnvelopeRowSolveItsBlocks) {
  for (const int size : {3, 6, 9}) {
    for (const int lead : {1, 2, 3, 4}) {
      // Row 4 has nothing in the columns before, row 5 little, and row 6 reaches far back.
      EnvelopeRows rows(size, lead, {0, 0, 1, 2, 4, 3, 0, 2, 2}, &random_);
      for (int i = 1; i < 9; ++i) {
        const int first = std::max(1, rows.FirstColumn(i));
        const int middle = (first + i) / 2;
        const AlignedVector<double> own = rows.Row(i);
        rows.MultiplyRow(i, first);
        // In two runs, the second with the block on the diagonal.
        if (middle > first) {
          rows.Run(kernels(), i, first, middle);
        }
        rows.Run(kernels(), i, middle, i);
        const AlignedVector<double> solved = rows.Row(i);
        rows.Row(i) = own;
        const auto at = [&](int r, int k) {
          return static_cast<std::size_t>(&rows.At(i, r, k) - &rows.At(i, 0, rows.Start(i)));
        };
        for (int r = 0; r < size; ++r) {
          for (int k = rows.Start(i); k < rows.Offset(i); ++k) {
            EXPECT_NEAR(solved[at(r, k)], own[at(r, k)], 1e-9) << size << ", row " << i;
          }
          for (int c = 0; c < size; ++c) {
            double square = 0.0;
            for (int k = rows.Offset(i); k < rows.Offset(i + 1); ++k) {
              square += own[at(r, k)] * own[at(c, k)];
            }
            EXPECT_NEAR(solved[at(r, rows.Offset(i) + c)], square, 1e-9) << size << ", row " << i;
          }
        }
      }
    }
  }
}

INCERES_FOR_ALL_INSTRUCTION_SETS(DenseKernels);

}  // namespace
}  // namespace inceres::internal
