#include "linear/envelope_cholesky.h"

#include <algorithm>

#include "base/growth_count.h"
#include "linear/envelope_order.h"
#include "linear/small_cholesky.h"
#include "simd/pack_block.h"

namespace inceres::internal {

// L Lᵀ = S + diag(damping) row by row inside the envelope (docs/algorithms.md, "Reduced linear
// systems", resuming; George & Liu 1981, chapter 4). With i the row and j < i, in this order,
//
//     L_ij = (A_ij − Σ_{k<j} L_ik L_jkᵀ) L_jj⁻ᵀ,    L_ii L_iiᵀ = A_ii − Σ_{k<i} L_ik L_ikᵀ.
//
// Row i needs rows up to i and nothing else: that is what lets a factorization be resumed, and why
// a row that is computed again has the bits that it has from scratch. The sums are dot products
// along two rows, where both have something; before the later start one of them is zero.
//
// A block row is stored from a whole quad on, so that rows that begin in different columns still
// meet on the boundaries of vectors. The gap up to three columns before its first one is zero, and
// stays zero: nothing is ever subtracted from it.

namespace {

// X := X L⁻ᵀ for a rows × size block X left of the lower triangular diagonal block L; both
// row-major. Each row of X is solved for by itself, and in it column c needs the columns before it.
// The reciprocals of the diagonal were kept by FactorSmall.
void SolveAgainstDiagonal(int rows, int size, const double* L, int ldl,
                          const double* inverse_pivots, double* X, int ldx) {
  for (int c = 0; c < size; ++c) {
    const double* L_row = L + static_cast<std::ptrdiff_t>(c) * ldl;
    for (int r = 0; r < rows; ++r) {
      double* row = X + static_cast<std::ptrdiff_t>(r) * ldx;
      double sum = row[c];
      for (int k = 0; k < c; ++k) {
        sum -= row[k] * L_row[k];
      }
      row[c] = sum * inverse_pivots[c];
    }
  }
}

}  // namespace

// Memory of rows is kept when there are fewer than before. What makes a row's bits the same resumed
// or not is that CopyRow writes it whole and FactorRow reads rows before it only.
bool EnvelopeCholesky::Factorize(const SymmetricBlockRows& S, const RowOrder& order,
                                 const double* damping, int first_changed, const char* held) {
  const int num_rows = order.num_places();
  // Rows that failed last time, or that no longer exist, are not to be built upon.
  const int first = std::min({first_changed, num_valid_rows_, num_rows});
  MakeRows(num_rows);
  num_rows_ = num_rows;
  offsets_.resize(first + 1);
  for (int i = first; i < num_rows; ++i) {
    offsets_.push_back(offsets_.back() + S.size_of(order.row(i)));
  }
  // Counted up row by row: after a failure it tells how far the factor is right.
  num_valid_rows_ = first;
  for (int i = first; i < num_rows; ++i) {
    CopyRow(S, order, damping, held, i);
    if (!FactorRow(i)) {
      return false;
    }
    num_valid_rows_ = i + 1;
  }
  return true;
}

void EnvelopeCholesky::MakeRows(int num_rows) {
  rows_.resize(std::max(rows_.size(), static_cast<std::size_t>(num_rows)));
  memory_.resize(rows_.size());
}

// For steps of part of the frames, whose size is bounded: once reserved, no step allocates.
void EnvelopeCholesky::Reserve(int num_rows, int row_entries, int size) {
  MakeRows(num_rows);
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    RowMemory& memory = memory_[i];
    const GrowthCount of_values(memory.values, &list_bytes_);
    const GrowthCount of_pivots(memory.inverse_pivots, &list_bytes_);
    memory.values.reserve(row_entries);
    memory.inverse_pivots.reserve(size);
    rows_[i].values = memory.values.data();
    rows_[i].inverse_pivots = memory.inverse_pivots.data();
  }
  offsets_.reserve(static_cast<std::size_t>(num_rows) + 1);
}

// Row i of A, where row i of L will be. The memory of the row that had this place is used again.
void EnvelopeCholesky::CopyRow(const SymmetricBlockRows& S, const RowOrder& order,
                               const double* damping, const char* held, int i) {
  EnvelopeRow& row = rows_[i];
  RowMemory& memory = memory_[i];
  const GrowthCount of_values(memory.values, &list_bytes_);
  const GrowthCount of_pivots(memory.inverse_pivots, &list_bytes_);
  const int size = BlockSize(i);
  row.first_column = FirstFreeColumn(S, held, order, i);
  row.held = IsHeld(held, order.row(i));
  // The start belongs to the structure of S and to what is held, not to values.
  row.start = offsets_[row.first_column] / kQuad * kQuad;
  row.stride = PadToQuad(offsets_[i + 1] - row.start);
  memory.values.resize(static_cast<std::size_t>(size) * row.stride);
  BestKernels().set_zero(static_cast<std::int64_t>(memory.values.size()), memory.values.data());
  memory.inverse_pivots.resize(size);
  row.values = memory.values.data();
  row.inverse_pivots = memory.inverse_pivots.data();
  if (!row.held) {
    CopyBlocks(S, order, held, i);
  }
  double* diagonal = row.values + offsets_[i] - row.start;
  for (int r = 0; r < size; ++r) {
    diagonal[static_cast<std::ptrdiff_t>(r) * row.stride + r] +=
        // Of a held row the identity: it never spoils the factor.
        row.held ? 1.0 : damping[offsets_[i] + r];
  }
}

// The blocks that row i of S shares with rows that come before it or are it. Those that have no
// place (-1) are left out.
void EnvelopeCholesky::CopyBlocks(const SymmetricBlockRows& S, const RowOrder& order,
                                  const char* held, int i) {
  EnvelopeRow& row = rows_[i];
  const int size = BlockSize(i);
  for (const SymmetricBlockRows::Entry& entry : S.row(order.row(i))) {
    const int j = order.place(entry.column);
    if (j < 0 || j > i || IsHeld(held, entry.column)) {
      continue;
    }
    // In S this block is left of the diagonal, or on it, and its place comes before or is i.
    PackBlock(size, BlockSize(j), S.values(entry.offset), row.values + offsets_[j] - row.start,
              row.stride);
  }
  for (const int other : S.below(order.row(i))) {
    const int j = order.place(other);
    if (j < 0 || j > i || IsHeld(held, other)) {
      continue;
    }
    const double* block = S.values(S.Find(other, order.row(i)));  // the transpose
    double* out = row.values + offsets_[j] - row.start;
    for (int c = 0; c < BlockSize(j); ++c) {
      for (int r = 0; r < size; ++r) {
        out[static_cast<std::ptrdiff_t>(r) * row.stride + c] = block[c * PadToQuad(size) + r];
      }
    }
  }
}

// All block columns from the first on, whether S has a block there or not: inside the envelope
// there is fill. The diagonal block at last; the kernels fill its square, and its lower triangle is
// what FactorSmall reads. Neighbors of the row's own size go to one call of a kernel that keeps the
// block solved last in registers; others go one by one. Which blocks are such a run follows from
// sizes alone.
bool EnvelopeCholesky::FactorRow(int i) {
  const EnvelopeRow& row = rows_[i];
  const int size = BlockSize(i);
  const bool is_small = size == 3 || size == 6 || size == 9;
  for (int j = row.first_column; j <= i;) {
    int end = j;
    while (is_small && end < i && BlockSize(end) == size) {
      ++end;
    }
    if (is_small && (end > j || end == i)) {
      BestKernels().solve_envelope_run(size, rows_.data(), offsets_.data(), i, j, end);
      j = end < i ? end : i + 1;
    } else {
      SolveBlock(i, j);
      ++j;
    }
  }
  return FactorSmall(size, row.values + offsets_[i] - row.start, row.stride, row.inverse_pivots);
}

// Both rows are zero before their starts: the sum begins at the later one, which is a whole quad.
// For j = i it is the diagonal block that loses L_ik L_ikᵀ, the row with itself. Cost: twice the
// depth times both sizes.
void EnvelopeCholesky::SolveBlock(int i, int j) {
  const EnvelopeRow& row = rows_[i];
  const EnvelopeRow& other = rows_[j];
  const int begin = std::max(row.start, other.start);
  const int depth = offsets_[j] - begin;
  double* A = row.values + begin - row.start;
  const double* B = other.values + begin - other.start;
  BestKernels().subtract_row_dots(BlockSize(i), BlockSize(j), depth, A, row.stride, B, other.stride,
                                  A + depth, row.stride);
  if (j < i) {
    SolveAgainstDiagonal(BlockSize(i), BlockSize(j), B + depth, other.stride, other.inverse_pivots,
                         A + depth, row.stride);
  }
}

// In x itself: forwards, and then row by row from the last one up.
void EnvelopeCholesky::Solve(const double* b, double* x) const {
  ForwardSubstitute(b, 0, x);
  for (int i = num_rows() - 1; i >= 0; --i) {
    BackSubstituteRow(i, x, x);
  }
}

// Row i is the dot product of L's row with y, which the row layout is made for; backwards a row of
// L is a column of Lᵀ, and takes its contribution out of all y before it.
void EnvelopeCholesky::ForwardSubstitute(const double* b, int first_row, double* y) const {
  const Kernels& kernels = BestKernels();
  for (int i = first_row; i < num_rows(); ++i) {
    const EnvelopeRow& row = rows_[i];
    const int size = BlockSize(i);
    double* y_i = y + offsets_[i];
    // b of a held row is not looked at.
    if (row.held) {
      std::fill_n(y_i, size, 0.0);
      continue;
    }
    std::copy_n(b + offsets_[i], size, y_i);
    // The product is with the y of the rows before, which is right up to here.
    const int length = offsets_[i] - row.start;
    kernels.subtract_row_dots(size, 1, length, row.values, row.stride, y + row.start, length, y_i,
                              1);
    const double* L = row.values + length;
    for (int r = 0; r < size; ++r, L += row.stride) {
      double sum = y_i[r];
      for (int k = 0; k < r; ++k) {
        sum -= L[k] * y_i[k];
      }
      y_i[r] = sum * row.inverse_pivots[r];
    }
  }
}

void EnvelopeCholesky::BackSubstituteRow(int i, double* rest, double* x) const {
  const EnvelopeRow& row = rows_[i];
  const int size = BlockSize(i);
  const int length = offsets_[i] - row.start;
  // x and rest may be the same vector: an entry of rest is read before x takes its place.
  double* x_i = x + offsets_[i];
  const double* rest_i = rest + offsets_[i];
  for (int c = size - 1; c >= 0; --c) {
    const double* L = row.values + length + c;  // column c of the diagonal block
    double sum = rest_i[c];
    for (int r = c + 1; r < size; ++r) {
      sum -= L[static_cast<std::ptrdiff_t>(r) * row.stride] * x_i[r];
    }
    x_i[c] = sum * row.inverse_pivots[c];
  }
  // The block row stored by rows is its transpose stored by columns.
  BestKernels().subtract_outer(length, 1, size, row.values, row.stride, x_i, 1, rest + row.start,
                               length);
}

}  // namespace inceres::internal
