// C += sign Σ BᵀA and y += sign Σ Aᵀv against plain loops, for every size and instruction set.
#include <algorithm>
#include <cmath>
#include <tuple>

#include "simd/kernel_fixture.h"

namespace inceres::internal {
namespace {

constexpr double kTolerance = 1e-13;
constexpr int kNumStored = 9;                 // blocks to choose terms from
constexpr std::int32_t kElsewhere = 1 << 29;  // where nothing is to be read

class ProductKernels : public KernelTest {
 protected:
  // Terms in an order that is not the one in memory, with repetitions.
  std::vector<ProductTerm> MakeTerms(int count, int depth, int a_size, int b_size) {
    std::vector<ProductTerm> terms;
    for (int p = 0; p < count; ++p) {
      terms.push_back({random_.Below(kNumStored) * depth * PadToQuad(a_size) / kQuad,
                       random_.Below(kNumStored) * depth * PadToQuad(b_size) / kQuad});
    }
    return terms;
  }

  static AlignedVector<double> NaiveProducts(const BlockProducts& products, double sign,
                                             AlignedVector<double> C) {
    const int a_stride = PadToQuad(products.a_size);
    const int b_stride = PadToQuad(products.b_size);
    for (int p = 0; p < products.count; ++p) {
      for (int k = 0; k < products.depth; ++k) {
        const double* a = products.a + products.terms[p].a * kQuad + k * a_stride;
        const double* b = products.b + products.terms[p].b * kQuad + k * b_stride;
        for (int r = 0; r < products.b_size; ++r) {
          for (int c = 0; c < products.a_size; ++c) {
            C[static_cast<std::size_t>(r * a_stride + c)] += sign * b[r] * a[c];
          }
        }
      }
    }
    return C;
  }

  void ExpectProducts(int depth, int a_size, int b_size, int count, double sign) {
    const AlignedVector<double> A = PaddedRows(kNumStored * depth, a_size);
    const AlignedVector<double> B = PaddedRows(kNumStored * depth, b_size);
    const std::vector<ProductTerm> terms = MakeTerms(count, depth, a_size, b_size);
    const BlockProducts products{A.data(), B.data(), terms.data(), count, depth, a_size, b_size};
    const AlignedVector<double> start = PaddedRows(b_size, a_size);
    AlignedVector<double> C = start;
    kernels().accumulate_products(products, sign, C.data());
    AlignedVector<double> C_generic = start;
    generic().accumulate_products(products, sign, C_generic.data());
    const std::string what = "depth " + std::to_string(depth) + ", " + std::to_string(b_size) +
                             " x " + std::to_string(a_size) + ", " + std::to_string(count) +
                             " terms";
    const double scale = 1.0 + count * depth;
    ExpectClose(C, NaiveProducts(products, sign, start), scale, kTolerance, what);
    ExpectClose(C, C_generic, scale, kTolerance, what + ", against generic");
  }
};

TEST_P(ProductKernels, EqualPlainLoopsForEverySize) {
  for (int depth = 1; depth <= 7; ++depth) {
    for (int a_size = 1; a_size <= 16; ++a_size) {
      for (int b_size = 1; b_size <= 16; ++b_size) {
        ExpectProducts(depth, a_size, b_size, 5, depth % 2 == 0 ? 1.0 : -1.0);
        if (HasFatalFailure()) {
          return;
        }
      }
    }
  }
}

TEST_P(ProductKernels, EqualPlainLoopsForLongResidualsAndLargeFrames) {
  for (const auto& [depth, a_size, b_size] :
       {std::tuple{15, 15, 15}, {17, 6, 9}, {31, 4, 1}, {2, 33, 20}, {3, 21, 40}}) {
    ExpectProducts(depth, a_size, b_size, 3, 1.0);
  }
}

// Rows without padding, blocks a quad too far apart; what lies between them is NaN. Entries that
// count are the same.
TEST_P(ProductKernels, RowsWithoutPaddingGiveTheSame) {
  for (int depth = 1; depth <= 6; ++depth) {
    for (int size = 1; size <= 21; ++size) {
      const AlignedVector<double> padded = PaddedRows(kNumStored * depth, size);
      const int stride = PadToQuad(depth * size) + kQuad;
      AlignedVector<double> A(static_cast<std::size_t>(kNumStored * stride), std::nan(""));
      for (int row = 0; row < kNumStored * depth; ++row) {
        std::copy_n(padded.data() + row * PadToQuad(size), size,
                    A.data() + row / depth * stride + row % depth * size);
      }
      const std::vector<double> v = random_.Vector(static_cast<std::size_t>(kNumStored * depth));
      std::vector<ProductTerm> terms, apart;
      std::vector<ProductTerm> vector_terms, vector_apart;
      for (int p = 0; p < 40; ++p) {
        const int a = random_.Below(kNumStored), b = random_.Below(kNumStored);
        const int quads = depth * PadToQuad(size) / kQuad;
        terms.push_back({a * quads, b * quads});
        apart.push_back({a * stride / kQuad, b * stride / kQuad});
        vector_terms.push_back({a * quads, b * depth});
        vector_apart.push_back({a * stride / kQuad, b * depth});
      }
      for (const bool symmetric : {false, true}) {
        for (int p = 0; symmetric && p < 40; ++p) {
          terms[static_cast<std::size_t>(p)].b = apart[static_cast<std::size_t>(p)].b = kElsewhere;
        }
        BlockProducts products{padded.data(), padded.data(), terms.data(), 40,       depth,
                               size,          size,          false,        symmetric};
        const auto rows = static_cast<std::size_t>(size * PadToQuad(size));
        AlignedVector<double> expected(rows, 0.0), C(rows, 0.0);
        kernels().accumulate_products(products, 1.0, expected.data());
        products.a = products.b = A.data();
        products.terms = apart.data();
        products.a_stride = products.b_stride = size;
        kernels().accumulate_products(products, 1.0, C.data());
        for (int r = 0; r < size; ++r) {
          for (int c = 0; c < (symmetric ? r + 1 : size); ++c) {
            const auto at = static_cast<std::size_t>(r * PadToQuad(size) + c);
            ASSERT_NEAR(C[at], expected[at], 40.0 * depth * kTolerance)
                << "size " << size << ", depth " << depth << ", " << r << " " << c;
          }
        }
      }
      VectorProducts vectors{padded.data(), v.data(), vector_terms.data(), 40, depth, size};
      AlignedVector<double> expected(static_cast<std::size_t>(PadToQuad(size)), 0.0), y = expected;
      kernels().accumulate_vectors(vectors, 1.0, expected.data());
      vectors.a = A.data();
      vectors.terms = vector_apart.data();
      vectors.a_stride = size;
      kernels().accumulate_vectors(vectors, 1.0, y.data());
      for (int c = 0; c < size; ++c) {
        ASSERT_NEAR(y[static_cast<std::size_t>(c)], expected[static_cast<std::size_t>(c)],
                    40.0 * depth * kTolerance);
      }
    }
  }
}

TEST_P(ProductKernels, NoTermsLeaveTheBlockAsItIs) {
  ExpectProducts(3, 9, 9, 0, -1.0);
}

TEST_P(ProductKernels, ManyTermsInOneCall) {
  ExpectProducts(3, 9, 9, 1000, -1.0);
  ExpectProducts(2, 6, 7, 1000, 1.0);
}

TEST_P(ProductKernels, BlocksWithTheirLastColumnApartGiveTheSame) {
  for (int size = 1; size <= 16; ++size) {
    for (int depth = 1; depth <= 4 && MayHaveTail(size); ++depth) {
      for (const int count : {0, 1, 5, 100}) {
        const AlignedVector<double> A = PaddedRows(kNumStored * depth, size);
        const AlignedVector<double> B = PaddedRows(kNumStored * depth, size);
        const AlignedVector<double> A_apart = WithTail(A, depth, size);
        const AlignedVector<double> B_apart = WithTail(B, depth, size);
        const std::vector<ProductTerm> terms = MakeTerms(count, depth, size, size);
        std::vector<ProductTerm> terms_apart = terms;
        const int padded_quads = depth * PadToQuad(size) / kQuad;
        for (ProductTerm& term : terms_apart) {
          term = {term.a / padded_quads * QuadsWithTail(depth, size),
                  term.b / padded_quads * QuadsWithTail(depth, size)};
        }
        const BlockProducts products{A.data(), B.data(), terms.data(), count, depth, size, size};
        const BlockProducts apart{
            A_apart.data(), B_apart.data(), terms_apart.data(), count, depth, size, size, true};
        const AlignedVector<double> start = PaddedRows(size, size);
        AlignedVector<double> C = start;
        kernels().accumulate_products(apart, -1.0, C.data());
        ExpectClose(C, NaiveProducts(products, -1.0, start), 1.0 + count * depth, kTolerance,
                    "size " + std::to_string(size) + ", depth " + std::to_string(depth) +
                        ", terms " + std::to_string(count));
        if (HasFatalFailure()) {
          return;
        }
      }
    }
  }
}

// The entries up to the diagonal have the bits they have without the hint, with their last column
// apart or not.
TEST_P(ProductKernels, SymmetricProductsHaveTheSameBits) {
  for (int size = 1; size <= 21; ++size) {
    for (int depth = 1; depth <= 5; ++depth) {
      for (const bool tail : {false, true}) {
        if (tail && (depth > 4 || !MayHaveTail(size))) {
          continue;
        }
        const AlignedVector<double> padded = PaddedRows(kNumStored * depth, size);
        const AlignedVector<double> A = tail ? WithTail(padded, depth, size) : padded;
        const int quads = tail ? QuadsWithTail(depth, size) : depth * PadToQuad(size) / kQuad;
        std::vector<ProductTerm> terms;
        for (int p = 0; p < 70; ++p) {
          const int at = random_.Below(kNumStored) * quads;
          terms.push_back({at, at});
        }
        BlockProducts products{A.data(), A.data(), terms.data(), 70, depth, size, size, tail};
        AlignedVector<double> whole(static_cast<std::size_t>(size) * PadToQuad(size), 0.0);
        AlignedVector<double> half = whole;
        kernels().accumulate_products(products, -1.0, whole.data());
        products.symmetric = true;
        for (ProductTerm& term : terms) {
          term.b = kElsewhere;
        }
        kernels().accumulate_products(products, -1.0, half.data());
        for (int r = 0; r < size; ++r) {
          for (int c = 0; c <= r; ++c) {
            const auto at = static_cast<std::size_t>(r * PadToQuad(size) + c);
            ASSERT_EQ(half[at], whole[at]) << "size " << size << ", depth " << depth << ", tail "
                                           << tail << ", " << r << " " << c;
          }
        }
      }
    }
  }
}

TEST_P(ProductKernels, SameBitsOnEveryCall) {
  const AlignedVector<double> A = PaddedRows(kNumStored * 2, 9);
  const std::vector<ProductTerm> terms = MakeTerms(20, 2, 9, 9);
  const BlockProducts products{A.data(), A.data(), terms.data(), 20, 2, 9, 9};
  AlignedVector<double> first(9 * 12, 0.0);
  AlignedVector<double> second(9 * 12, 0.0);
  kernels().accumulate_products(products, 1.0, first.data());
  kernels().accumulate_products(products, 1.0, second.data());
  EXPECT_EQ(first, second);
}

TEST_P(ProductKernels, VectorProductsEqualPlainLoops) {
  for (const int depth : {1, 2, 3, 4, 5, 6, 7, 17}) {
    for (int size = 1; size <= 30; ++size) {
      const AlignedVector<double> A = PaddedRows(kNumStored * depth, size);
      const std::vector<double> v = random_.Vector(static_cast<std::size_t>(kNumStored * depth));
      std::vector<ProductTerm> terms;
      for (int p = 0; p < 7; ++p) {
        terms.push_back({random_.Below(kNumStored) * depth * PadToQuad(size) / kQuad,
                         random_.Below(kNumStored) * depth});
      }
      const VectorProducts products{A.data(), v.data(), terms.data(), 7, depth, size};
      const AlignedVector<double> start = PaddedRows(1, size);
      AlignedVector<double> expected = start;
      for (const ProductTerm& term : terms) {
        for (int k = 0; k < depth; ++k) {
          for (int c = 0; c < size; ++c) {
            expected[static_cast<std::size_t>(c)] -=
                A[static_cast<std::size_t>(term.a * kQuad + k * PadToQuad(size) + c)] *
                v[static_cast<std::size_t>(term.b + k)];
          }
        }
      }
      AlignedVector<double> y = start;
      kernels().accumulate_vectors(products, -1.0, y.data());
      ExpectClose(y, expected, 7.0 * depth, kTolerance,
                  "size " + std::to_string(size) + ", depth " + std::to_string(depth));
      if (HasFatalFailure()) {
        return;
      }
    }
  }
}

TEST_P(ProductKernels, VectorProductsOfBlocksWithTheirLastColumnApart) {
  for (const int size : {5, 9, 13}) {
    for (int depth = 1; depth <= 4; ++depth) {
      const AlignedVector<double> A = PaddedRows(kNumStored * depth, size);
      const AlignedVector<double> A_apart = WithTail(A, depth, size);
      const AlignedVector<double> v = PaddedRows(kNumStored, depth);
      std::vector<ProductTerm> terms;
      std::vector<ProductTerm> terms_apart;
      for (int p = 0; p < 7; ++p) {
        const int block = random_.Below(kNumStored);
        const int vector = random_.Below(kNumStored);
        terms.push_back({block * depth * PadToQuad(size) / kQuad, vector * kQuad});
        terms_apart.push_back({block * QuadsWithTail(depth, size), vector * kQuad});
      }
      AlignedVector<double> y = PaddedRows(1, size);
      AlignedVector<double> expected = y;
      kernels().accumulate_vectors({A.data(), v.data(), terms.data(), 7, depth, size}, -1.0,
                                   expected.data());
      kernels().accumulate_vectors(
          {A_apart.data(), v.data(), terms_apart.data(), 7, depth, size, true}, -1.0, y.data());
      ExpectClose(y, expected, 7.0 * depth, kTolerance,
                  "size " + std::to_string(size) + ", depth " + std::to_string(depth));
    }
  }
}

// What replaces goes in while the old goes out.
TEST_P(ProductKernels, ReplacedContributionsEqualTwoPasses) {
  constexpr int kSizes[3] = {6, 9, 3};
  for (int depth = 1; depth <= 8; ++depth) {
    std::vector<AlignedVector<double>> stored;
    std::vector<BlockRow> rows;
    std::vector<BlockRow> old_rows;
    std::vector<std::int32_t> blocks;
    std::int32_t quads = 0;
    std::int32_t room = 0;
    for (const int size : kSizes) {
      const std::int32_t row_quads = PadToQuad(size) / kQuad;
      stored.push_back(PaddedRows(depth, size));
      const double* old = stored.back().data();
      stored.push_back(PaddedRows(depth, size));
      rows.push_back({stored.back().data(), quads, row_quads, size, old});
      old_rows.push_back({old, quads, row_quads, size});
      quads += row_quads;
      for (const BlockRow& column : rows) {
        blocks.push_back(rows.size() == 3 && column.size == 9 ? -1 : room);
        room += size * column.quads;
      }
    }
    const std::vector<double> v = random_.Vector(static_cast<std::size_t>(depth));
    const std::vector<double> v_old = random_.Vector(static_cast<std::size_t>(depth));
    const Contribution in{rows.data(), 3, depth};
    const Contribution out{old_rows.data(), 3, depth};
    const Contribution replacing{rows.data(), 3, depth, true};
    const auto check = [&](std::int32_t size, auto&& in_two, auto&& at_once, const char* what) {
      AlignedVector<double> expected = PaddedRows(1, size * kQuad);
      AlignedVector<double> actual = expected;
      in_two(&expected);
      at_once(&actual);
      ExpectClose(actual, expected, 2.0 * depth + 1.0, kTolerance, what + std::to_string(depth));
    };
    AlignedVector<double> peak(static_cast<std::size_t>(quads) * kQuad, 0.0);
    using Vector = AlignedVector<double>*;
    check(
        room,
        [&](Vector C) {
          kernels().add_outer(out, 1.0, blocks.data(), C->data());
          kernels().add_outer(in, -1.0, blocks.data(), C->data());
        },
        [&](Vector C) { kernels().add_outer(replacing, -1.0, blocks.data(), C->data()); },
        "outer, depth ");
    check(
        quads,
        [&](Vector y) {
          kernels().add_transposed(out, v_old.data(), nullptr, 1.0, y->data(), peak.data());
          kernels().add_transposed(in, v.data(), nullptr, -1.0, y->data(), peak.data());
        },
        [&](Vector y) {
          kernels().add_transposed(replacing, v.data(), v_old.data(), -1.0, y->data(), peak.data());
        },
        "transposed, depth ");
    check(
        quads,
        [&](Vector y) {
          kernels().add_squares(out, 1.0, y->data(), peak.data());
          kernels().add_squares(in, -1.0, y->data(), peak.data());
        },
        [&](Vector y) { kernels().add_squares(replacing, -1.0, y->data(), peak.data()); },
        "squares, depth ");
  }
}

// Three block rows of different sizes; one block is left out, and what stands in C between the
// blocks stays.
TEST_P(ProductKernels, ContributionsEqualPlainLoops) {
  for (int depth = 1; depth <= 8; ++depth) {
    for (int size = 1; size <= 13; ++size) {
      const int sizes[3] = {6, size, 9};
      std::vector<AlignedVector<double>> A;
      std::vector<BlockRow> rows;
      std::int32_t quads = 0;
      for (const int row_size : sizes) {
        A.push_back(PaddedRows(depth, row_size));
        rows.push_back({A.back().data(), quads, PadToQuad(row_size) / kQuad, row_size});
        quads += PadToQuad(row_size) / kQuad;
      }
      std::vector<std::int32_t> blocks;
      std::int32_t room = 1;
      for (int r = 0; r < 3; ++r) {
        for (int c = 0; c <= r; ++c) {
          const bool left_out = r == 2 && c == 1;
          blocks.push_back(left_out ? -1 : room);
          room += left_out ? 0 : sizes[r] * rows[c].quads + 1;
        }
      }
      const AlignedVector<double> C_start = PaddedRows(1, room * kQuad);
      const AlignedVector<double> y_start = PaddedRows(1, quads * kQuad);
      const std::vector<double> v = random_.Vector(static_cast<std::size_t>(depth));
      AlignedVector<double> C_expected = C_start;
      AlignedVector<double> y_expected = y_start;
      AlignedVector<double> squares_expected = y_start;
      std::size_t at = 0;
      for (std::size_t r = 0; r < 3; ++r) {
        const auto entry = [&](std::size_t row, int k, int i) {
          return A[row][static_cast<std::size_t>(k * rows[row].quads * kQuad + i)];
        };
        for (int k = 0; k < depth; ++k) {
          for (int i = 0; i < sizes[r]; ++i) {
            const auto place = static_cast<std::size_t>(rows[r].frame * kQuad + i);
            y_expected[place] -= entry(r, k, i) * v[static_cast<std::size_t>(k)];
            squares_expected[place] -= entry(r, k, i) * entry(r, k, i);
          }
        }
        for (std::size_t c = 0; c <= r; ++c, ++at) {
          for (int i = 0; i < sizes[r] && blocks[at] >= 0; ++i) {
            for (int j = 0; j < sizes[c]; ++j) {
              for (int k = 0; k < depth; ++k) {
                C_expected[static_cast<std::size_t>((blocks[at] + i * rows[c].quads) * kQuad +
                                                    j)] -= entry(r, k, i) * entry(c, k, j);
              }
            }
          }
        }
      }
      const std::string what = "size " + std::to_string(size) + ", depth " + std::to_string(depth);
      const Contribution contribution{rows.data(), 3, depth};
      AlignedVector<double> C = C_start;
      kernels().add_outer(contribution, -1.0, blocks.data(), C.data());
      ExpectClose(C, C_expected, depth + 1.0, kTolerance, what + ", outer");
      AlignedVector<double> y = y_start;
      AlignedVector<double> peak(y.size(), 0.25);
      kernels().add_transposed(contribution, v.data(), nullptr, -1.0, y.data(), peak.data());
      ExpectClose(y, y_expected, depth + 1.0, kTolerance, what + ", transposed");
      AlignedVector<double> squares = y_start;
      kernels().add_squares(contribution, -1.0, squares.data(), peak.data());
      ExpectClose(squares, squares_expected, depth + 1.0, kTolerance, what + ", squares");
      for (std::size_t k = 0; k < peak.size(); ++k) {
        ASSERT_EQ(peak[k], std::max({0.25, std::fabs(y[k]), std::fabs(squares[k])}))
            << what << ", entry " << k;
      }
    }
  }
}

TEST_P(ProductKernels, SetZeroTakesWholeQuadsAndNoMore) {
  for (int count = 0; count <= 40; count += kQuad) {
    std::vector<double> A(static_cast<std::size_t>(count + 1), 77.0);
    kernels().set_zero(count, A.data());
    EXPECT_EQ(std::count(A.begin(), A.end(), 0.0), count);
    EXPECT_EQ(A.back(), 77.0) << count;
  }
}

// Every remainder of a vector; what lies between the columns stays as it is.
TEST_P(ProductKernels, AddColumnsAddsEachEntryAlone) {
  constexpr int kColumns = 3;
  for (int rows = 0; rows <= 13; ++rows) {
    const int lda = rows + 1, ldc = rows + 2;
    const std::vector<double> A = random_.Vector(static_cast<std::size_t>(lda * kColumns));
    std::vector<double> C = random_.Vector(static_cast<std::size_t>(ldc * kColumns));
    std::vector<double> expected = C;
    for (int c = 0; c < kColumns; ++c) {
      for (int r = 0; r < rows; ++r) {
        expected[static_cast<std::size_t>(c * ldc + r)] += A[static_cast<std::size_t>(c * lda + r)];
      }
    }
    kernels().add_columns(rows, kColumns, A.data(), lda, C.data(), ldc);
    EXPECT_EQ(C, expected) << rows << " rows";
  }
}

// Two segments of two sources, of two terms and one: C without padding, and y, as by the kernels
// that sum a segment into zeros.
TEST_P(ProductKernels, SumsOfSmallBlocksHaveTheBitsOfTheirParts) {
  for (const int depth : {3, 6}) {
    const AlignedVector<double> A = PaddedRows(4 * depth, 3), B = PaddedRows(4 * depth, 3);
    const std::vector<double> v = random_.Vector(static_cast<std::size_t>(4 * depth));
    const SmallSource sources[] = {{A.data(), B.data(), v.data()}, {B.data(), A.data(), v.data()}};
    const SmallTerm terms[] = {{0, depth, depth, 0, false},
                               {3 * depth, 2 * depth, 0, 0, true},
                               {depth, depth, 2 * depth, 1, true}};
    AlignedVector<double> C_parts(3 * kQuad, 0.0), y_parts(kQuad, 0.0);
    const ProductTerm products[] = {{0, depth}, {3 * depth, 2 * depth}, {depth, depth}};
    const ProductTerm vectors[] = {{0, depth}, {3 * depth, 0}, {depth, 2 * depth}};
    for (int s = 0; s < 2; ++s) {
      const int first = 2 * s, count = 2 - s;
      kernels().accumulate_products(
          {sources[s].a, sources[s].b, products + first, count, depth, 3, 3}, 1.0, C_parts.data());
      kernels().accumulate_vectors({sources[s].a, v.data(), vectors + first, count, depth, 3}, 1.0,
                                   y_parts.data());
    }
    // On the diagonal, not on it, and behind a gap that is not written.
    const SmallBlock blocks[] = {{0, 0, 3, 4}, {9, 0, 3, -1}, {20, 0, 3, 0}};
    double C[30], y[8], diagonal[8];
    std::fill_n(C, 30, 77.0);
    std::fill_n(y, 8, 77.0);
    kernels().sum_products_of_three({sources, terms, depth}, blocks, 3, C, y, diagonal);
    for (int c = 0; c < 3; ++c) {
      for (int r = 0; r < 3; ++r) {
        for (const SmallBlock& block : blocks) {
          EXPECT_EQ(C[block.C + 3 * c + r], C_parts[static_cast<std::size_t>(c * kQuad + r)])
              << depth;
        }
      }
      for (const int at : {4, 0}) {
        EXPECT_EQ(y[at + c], y_parts[static_cast<std::size_t>(c)]) << depth;
        EXPECT_EQ(diagonal[at + c], C[4 * c]) << depth;
      }
    }
    EXPECT_EQ(C[18], 77.0);
    EXPECT_EQ(C[29], 77.0);
    EXPECT_EQ(y[3], 77.0);
    EXPECT_EQ(y[7], 77.0);
  }
}

// Of poses in the plane and in space, and of what images see of these, which have a pass of their
// own, and of others: two rows, one block left out.
TEST_P(ProductKernels, WholeContributionsHaveTheBitsOfTheirParts) {
  for (const auto& [depth, size] : {std::pair{3, 3}, {6, 6}, {2, 6}, {2, 5}, {5, 5}}) {
    for (const bool replaces : {false, true}) {
      for (const double sign : {1.0, -1.0}) {
        const int row_quads = PadToQuad(size) / kQuad;
        std::vector<AlignedVector<double>> stored;
        std::vector<BlockRow> rows;
        for (int r = 0; r < 2; ++r) {
          stored.push_back(PaddedRows(depth, size));
          const double* old = stored.back().data();
          stored.push_back(PaddedRows(depth, size));
          rows.push_back({stored.back().data(), r * row_quads, row_quads, size, old});
        }
        const std::vector<std::int32_t> blocks{0, -1, size * row_quads};
        const std::vector<double> v = random_.Vector(static_cast<std::size_t>(depth));
        const std::vector<double> v_old = random_.Vector(static_cast<std::size_t>(depth));
        const Contribution contribution{rows.data(), 2, depth, replaces};
        AlignedVector<double> C = PaddedRows(2 * size, size), C_parts = C;
        AlignedVector<double> y = PaddedRows(2, size), y_parts = y;
        AlignedVector<double> squares = PaddedRows(2, size), squares_parts = squares;
        AlignedVector<double> peak(y.size(), 0.25), peak_parts = peak;
        AlignedVector<double> peak2(y.size(), 0.5), peak2_parts = peak2;
        kernels().add_contribution(contribution, sign,
                                   {blocks.data(), C.data(), v.data(), v_old.data(), y.data(),
                                    peak.data(), squares.data(), peak2.data()});
        kernels().add_outer(contribution, sign, blocks.data(), C_parts.data());
        kernels().add_transposed(contribution, v.data(), v_old.data(), -sign, y_parts.data(),
                                 peak_parts.data());
        kernels().add_squares(contribution, sign, squares_parts.data(), peak2_parts.data());
        EXPECT_EQ(C, C_parts) << size;
        EXPECT_EQ(y, y_parts) << size;
        EXPECT_EQ(squares, squares_parts) << size;
        EXPECT_EQ(peak, peak_parts) << size;
        EXPECT_EQ(peak2, peak2_parts) << size;
      }
    }
  }
}

INCERES_FOR_ALL_INSTRUCTION_SETS(ProductKernels);

TEST(Kernels, TheBestSetIsOneOfTheSets) {
  const Kernels* best = &BestKernels();
  EXPECT_TRUE(
      best == KernelsFor(InstructionSet::kGeneric) || best == KernelsFor(InstructionSet::kAvx2) ||
      best == KernelsFor(InstructionSet::kAvx512) || best == KernelsFor(InstructionSet::kNeon));
#ifdef __aarch64__
  EXPECT_STREQ(best->name, "neon");
#endif
  EXPECT_STREQ(KernelsFor(InstructionSet::kGeneric)->name, "generic");
}

TEST(Kernels, PaddingIsTheNextMultipleOfFour) {
  EXPECT_EQ(PadToQuad(0), 0);
  EXPECT_EQ(PadToQuad(1), 4);
  EXPECT_EQ(PadToQuad(4), 4);
  EXPECT_EQ(PadToQuad(9), 12);
}

}  // namespace
}  // namespace inceres::internal
