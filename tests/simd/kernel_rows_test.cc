// What a pass over J yields for a vector: −(Jv)ᵀ(f + Jv/2) and ‖Jv‖²; and with it the change Jᵀ(f −
// p) of a gradient.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <vector>

#include "simd/kernel_fixture.h"

namespace inceres::internal {
namespace {

class RowKernels : public KernelTest {
 protected:
  // Factors of three slots (sizes 9, 3 and frame_size); variables stand in the tangent vector in an
  // order of their own, and the third slot of every other factor is a constant.
  void ExpectRowProducts(int rows, int frame_size) {
    constexpr int kNumFactors = 7;
    const int sizes[3] = {9, 3, frame_size};
    std::vector<AlignedVector<double>> storage;
    std::vector<SlotJacobians> jacobians;
    for (const int size : sizes) {
      storage.push_back(PaddedRows(kNumFactors * rows, size));
      jacobians.push_back(
          {storage.back().data(), std::ptrdiff_t{rows} * PadToQuad(size), PadToQuad(size), size});
    }
    const std::vector<double> f = random_.Vector(static_cast<std::size_t>(kNumFactors * rows));
    // Two variables a slot: quads 0 and 3 for size 9, 6 and 7 for size 3, then those of frame_size.
    const int quads = PadToQuad(frame_size) / kQuad;
    const AlignedVector<double> nine = PaddedRows(2, 9);
    const AlignedVector<double> three = PaddedRows(2, 3);
    const AlignedVector<double> last = PaddedRows(2, frame_size);
    AlignedVector<double> v;
    for (const AlignedVector<double>* part : {&nine, &three, &last}) {
      v.insert(v.end(), part->begin(), part->end());
    }
    std::vector<std::int32_t> offsets;
    for (int i = 0; i < kNumFactors; ++i) {
      offsets.push_back(i % 2 == 0 ? 3 : 0);
      offsets.push_back(i % 3 == 0 ? 6 : 7);
      offsets.push_back(i % 2 == 0 ? -1 : 8 + (i % 3 == 0 ? quads : 0));
    }
    double decrease = 0.0;
    double squared_norm = 0.0;
    for (int i = 2; i < 6; ++i) {
      for (int r = 0; r < rows; ++r) {
        double Jv = 0.0;
        for (int s = 0; s < 3; ++s) {
          const int offset = offsets[static_cast<std::size_t>(3 * i + s)];
          for (int c = 0; offset >= 0 && c < sizes[s]; ++c) {
            Jv += storage[static_cast<std::size_t>(s)]
                         [static_cast<std::size_t>((i * rows + r) * PadToQuad(sizes[s]) + c)] *
                  v[static_cast<std::size_t>(offset * kQuad + c)];
          }
        }
        decrease -= Jv * (f[static_cast<std::size_t>(i * rows + r)] + 0.5 * Jv);
        squared_norm += Jv * Jv;
      }
    }
    const FactorRows factor_rows{2, 6, rows, 3, jacobians.data(), f.data(), offsets.data()};
    const RowProducts actual = kernels().row_products(factor_rows, v.data());
    const double scale = 100.0 * rows * frame_size;
    EXPECT_NEAR(actual.model_decrease, decrease, 1e-13 * scale)
        << rows << " rows, frame size " << frame_size;
    EXPECT_NEAR(actual.squared_norm, squared_norm, 1e-13 * scale)
        << rows << " rows, frame size " << frame_size;
    const RowProducts reference = generic().row_products(factor_rows, v.data());
    EXPECT_NEAR(actual.model_decrease, reference.model_decrease, 1e-13 * scale);
    EXPECT_NEAR(actual.squared_norm, reference.squared_norm, 1e-13 * scale);
    ExpectSameByFactor<double>(factor_rows, v, actual, 1e-13 * scale);
    ExpectSameByFactor<float>(factor_rows, v, actual, 1e-6 * scale);
    ExpectTriedRows(factor_rows, {2, 3, 4, 5}, v, decrease);
    ExpectTriedRows(factor_rows, {}, v, 0.0);
  }

  // Of the same Jacobians, those of a factor together and rows without padding, in T. What nobody
  // may use is NaN.
  template <typename T>
  void ExpectSameByFactor(FactorRows rows, const AlignedVector<double>& v,
                          const RowProducts& expected, double tolerance) {
    constexpr int kNumFactors = 7;
    std::vector<SlotJacobians> jacobians(rows.jacobians, rows.jacobians + rows.num_slots);
    int size = 0;
    for (const SlotJacobians& slot : jacobians) {
      size += rows.residual_size * slot.columns;
    }
    const std::ptrdiff_t stride = PadToQuad(size);
    AlignedVector<T> entries(static_cast<std::size_t>(kNumFactors * stride + kQuad),
                             std::numeric_limits<T>::quiet_NaN());
    T* next = entries.data();
    for (SlotJacobians& slot : jacobians) {
      for (int i = rows.begin; i < rows.end; ++i) {
        for (int r = 0; r < rows.residual_size; ++r) {
          const double* const row = slot.data + i * slot.factor_stride + r * slot.row_stride;
          std::transform(row, row + slot.columns, next + i * stride + r * slot.columns,
                         [](double entry) { return static_cast<T>(entry); });
        }
      }
      slot = UnpaddedSlot(next, stride, slot.columns);
      next += rows.residual_size * slot.columns;
    }
    rows.jacobians = jacobians.data();
    const RowProducts actual = kernels().row_products(rows, v.data());
    EXPECT_NEAR(actual.model_decrease, expected.model_decrease, tolerance);
    EXPECT_NEAR(actual.squared_norm, expected.squared_norm, tolerance);
  }

  // try_rows is multiply_rows, the decrease, and subtract_transposed of p − f, in one pass.
  void ExpectTriedRows(const FactorRows& rows, const std::vector<std::int32_t>& factors,
                       const AlignedVector<double>& v, double decrease) {
    constexpr std::size_t kNumFactors = 7;
    const std::size_t size = kNumFactors * static_cast<std::size_t>(rows.residual_size);
    const std::vector<double> p = random_.Vector(size);
    std::vector<double> change(size);
    for (std::size_t k = 0; k < size; ++k) {
      change[k] = p[k] - rows.residuals[k];
    }
    const auto count = static_cast<int>(factors.size());
    std::vector<double> product(size, 0.5);
    AlignedVector<double> y = PaddedRows(static_cast<int>(v.size()) / kQuad, kQuad);
    std::vector<double> expected_product = product;
    AlignedVector<double> expected_y = y;
    generic().multiply_rows(rows, factors.data(), count, v.data(), expected_product.data());
    generic().subtract_transposed(rows, factors.data(), count, change.data(), expected_y.data());
    const double actual = kernels().try_rows(rows, factors.data(), count, v.data(), p.data(),
                                             product.data(), y.data());
    EXPECT_NEAR(actual, decrease, 1e-11 * rows.residual_size * static_cast<double>(v.size()));
    ExpectClose(product, expected_product, static_cast<double>(v.size()), 1e-13, "J v");
    ExpectClose(y, expected_y, static_cast<double>(size), 1e-13, "y");
  }

  // `take` of blocks one after the other into blocks with room around their rows: entry(row, block,
  // column) is what comes of a row.
  template <typename Take, typename Entry>
  void ExpectTake(int blocks, int rows, int ambient_size, int columns, const Take& take,
                  const Entry& entry) {
    const auto count = static_cast<std::size_t>(blocks * rows * ambient_size);
    const std::vector<double> J = random_.Vector(count);
    const int row_stride = columns + 3;
    const std::ptrdiff_t factor_stride = rows * row_stride + 5;
    std::vector<double> out(static_cast<std::size_t>(blocks * factor_stride), 77.0);
    std::vector<double> expected = out;
    for (int n = 0; n < blocks; ++n) {
      for (int r = 0; r < rows; ++r) {
        for (int c = 0; c < columns; ++c) {
          expected[static_cast<std::size_t>(n * factor_stride + r * row_stride + c)] =
              entry(J.data() + std::ptrdiff_t{n * rows + r} * ambient_size, n, c);
        }
      }
    }
    const std::vector<double> untouched = out;
    EXPECT_TRUE(take(J.data(), out.data(), factor_stride, row_stride));
    EXPECT_EQ(out, expected) << blocks << " of " << rows << " rows, " << ambient_size << " to "
                             << columns;
    for (std::size_t k = 0; k < count; ++k) {
      for (const double bad : {std::nan(""), -HUGE_VAL, kUnwrittenEntry}) {
        std::vector<double> with_bad = J;
        with_bad[k] = bad;
        out = untouched;
        EXPECT_FALSE(take(with_bad.data(), out.data(), factor_stride, row_stride)) << "entry " << k;
        EXPECT_EQ(out, untouched);
      }
    }
  }
};

TEST_P(RowKernels, EqualPlainLoopsForEverySize) {
  for (const int rows : {1, 2, 3, 4, 5, 6, 15, 17}) {
    for (int frame_size = 1; frame_size <= 16; ++frame_size) {
      ExpectRowProducts(rows, frame_size);
    }
  }
}

// What is not copied stays as it was, all of it where something is not ordinary.
TEST_P(RowKernels, TakeColumns) {
  for (int ambient_size = 1; ambient_size <= 20; ++ambient_size) {
    for (int columns = 1; columns <= ambient_size; ++columns) {
      for (const int rows : {0, 1, 2, 3, 15}) {
        const ColumnTake take = kernels().find_take(rows, ambient_size, columns);
        for (const int blocks : {0, 1, 2, 5}) {
          if (take != nullptr) {
            ExpectTake(
                blocks, rows, ambient_size, columns,
                [&](const double* J, double* out, std::ptrdiff_t factor_stride, int row_stride) {
                  return take(blocks, J, rows, out, factor_stride, row_stride);
                },
                [&](const double* row, int, int column) { return row[column]; });
          }
        }
      }
    }
  }
  EXPECT_NE(kernels().find_take(2, 7, 6), nullptr);
}

// To the bit the product by a plain loop over the rows of M: of a position and a quaternion, whose
// first rows and columns are those of the identity, and of a quaternion alone.
TEST_P(RowKernels, TakePosesAndQuaternionsAsAPlainProduct) {
  for (const int copied : {3, 0}) {
    const int ambient = copied + 4, tangent = copied + 3;
    const auto take = copied > 0 ? kernels().take_poses : kernels().take_quaternions;
    for (const int rows : {1, 2, 3, 6, 15}) {
      for (const int blocks : {0, 1, 2, 5}) {
        std::vector<std::vector<double>> M;
        std::vector<const double*> pointers;
        for (int n = 0; n < blocks; ++n) {
          M.push_back(random_.Vector(static_cast<std::size_t>(ambient * tangent)));
          for (int k = 0; k < ambient * tangent; ++k) {
            if (k < copied * tangent || k % tangent < copied) {
              M.back()[static_cast<std::size_t>(k)] = k / tangent == k % tangent ? 1.0 : 0.0;
            }
          }
        }
        for (const std::vector<double>& matrix : M) {
          pointers.push_back(matrix.data());
        }
        ExpectTake(
            blocks, rows, ambient, tangent,
            [&](const double* J, double* out, std::ptrdiff_t factor_stride, int row_stride) {
              return take(pointers.data(), blocks, J, rows, out, factor_stride, row_stride);
            },
            [&](const double* row, int block, int column) {
              double sum = 0.0;
              for (int k = 0; k < ambient; ++k) {
                const volatile double term =
                    row[k] * pointers[static_cast<std::size_t>(block)][tangent * k + column];
                sum += term;
              }
              return sum;
            });
      }
    }
  }
}

// Rows padded or not: what lies between and behind them stays as it is.
TEST_P(RowKernels, CorrectTheSlotsThatHaveAnOffset) {
  const int sizes[3] = {9, 3, 6};
  const std::int32_t offsets[3] = {4, -1, 0};
  const double f[3] = {0.5, -1.5, 0.25};
  for (const int kind : {2, 3, 4, 5, 6, 7}) {
    const int rows = kind / 2;
    const bool padded = kind % 2 == 0;
    for (const double a : {0.0, 0.2}) {
      std::vector<AlignedVector<double>> storage;
      std::vector<SlotJacobians> jacobians;
      for (const int size : sizes) {
        storage.push_back(PaddedRows(3 * rows, size));
        jacobians.push_back({storage.back().data(), std::ptrdiff_t{rows} * PadToQuad(size),
                             padded ? PadToQuad(size) : size, size});
      }
      std::vector<AlignedVector<double>> expected = storage;
      for (const std::size_t s : {0, 2}) {
        double* J = expected[s].data() + jacobians[s].factor_stride;
        for (int c = 0; c < sizes[s]; ++c) {
          double along = 0.0;
          for (int r = 0; r < rows; ++r) {
            along += a * f[r] * J[r * jacobians[s].row_stride + c];
          }
          for (int r = 0; r < rows; ++r) {
            double& entry = J[r * jacobians[s].row_stride + c];
            entry = 0.3 * (entry - f[r] * along);
          }
        }
      }
      const FactorScale scale = {0.3, a};
      kernels().correct_factors(jacobians.data(), 3, 1, 1, offsets, f, rows, &scale);
      for (std::size_t s = 0; s < 3; ++s) {
        for (std::size_t k = 0; k < storage[s].size(); ++k) {
          EXPECT_NEAR(storage[s][k], expected[s][k], 1e-15)
              << rows << " rows, a " << a << ", slot " << s;
        }
      }
    }
  }
}

TEST_P(RowKernels, NoFactorsYieldZero) {
  const FactorRows rows;
  const RowProducts actual = kernels().row_products(rows, nullptr);
  EXPECT_EQ(actual.model_decrease, 0.0);
  EXPECT_EQ(actual.squared_norm, 0.0);
}

TEST_P(RowKernels, FindWhatIsNotOrdinaryWhereverItIs) {
  for (const int count : {0, 1, 2, 3, 4, 5, 15, 16, 17, 37}) {
    std::vector<double> values = random_.Vector(static_cast<std::size_t>(count));
    EXPECT_TRUE(kernels().are_ordinary(values.data(), count)) << count;
    for (double& value : values) {
      const double kept = value;
      for (const double bad :
           {kUnwrittenEntry, -kUnwrittenEntry, std::numeric_limits<double>::quiet_NaN(),
            -std::numeric_limits<double>::infinity()}) {
        value = bad;
        EXPECT_FALSE(kernels().are_ordinary(values.data(), count)) << count;
      }
      value = kept;
    }
  }
}

TEST_P(RowKernels, FindWhatIsNotZeroWhereverItIs) {
  for (const int count : {0, 1, 3, 4, 5, 16, 17, 37, 80}) {
    std::vector<double> values(static_cast<std::size_t>(count), -0.0);
    EXPECT_EQ(kernels().find_nonzero(values.data(), 0, count), count);
    for (int k = 0; k < count; ++k) {
      for (const double entry : {1.0, std::numeric_limits<double>::denorm_min(),
                                 std::numeric_limits<double>::quiet_NaN()}) {
        values[static_cast<std::size_t>(k)] = entry;
        EXPECT_EQ(kernels().find_nonzero(values.data(), 0, count), k) << count;
        EXPECT_EQ(kernels().find_nonzero(values.data(), k, count), k) << count;
        EXPECT_EQ(kernels().find_nonzero(values.data(), k + 1, count), count) << k;
      }
      values[static_cast<std::size_t>(k)] = 0.0;
    }
  }
}

INCERES_FOR_ALL_INSTRUCTION_SETS(RowKernels);

}  // namespace
}  // namespace inceres::internal
