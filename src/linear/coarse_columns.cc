#include "linear/coarse_columns.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "base/counting_sort.h"
#include "linear/pattern_rows.h"
#include "simd/kernels.h"

namespace inceres::internal {

// Coarse columns V of a two-level preconditioner (docs/algorithms.md, "Reduced linear systems", two
// levels; Mandel 1993): products with V and A V, the Gram–Schmidt process, and the Galerkin product
// VᵀA V. Others write V and A V.
//
// V has one block a row of A, in the columns of the row's aggregate, so products with V cost one
// pass over the rows. A V has a block where the columns of an aggregate reach a row, and is kept,
// so that the preconditioner takes no product with A.
//
// Each sum has one task and one order: by members or coupled rows of an aggregate where the result
// is by columns (Vᵀ r, (A V)ᵀ z), by aggregates of a row where it is by rows (A V q, V q). So the
// bits do not depend on the number of threads.

namespace {

// Aggregates, and rows, that are worth a task.
constexpr int kAggregateGrain = 4;
constexpr int kCoarseRowGrain = 64;
// A column that keeps less than this share of its length is one that the others hold.
constexpr double kDependent = 1e-7;

// x += Bᵀ r of a block of `rows` × `stride`, the first `width` columns.
// Rows of B are padded with zeros to whole quads, so a quad of sums may be taken past the width;
// only what is within it is added.
void AddTransposed(const double* B, int rows, int stride, int width, const double* r, double* x) {
  for (int first = 0; first < width; first += kQuad) {
    double sum[kQuad] = {};
    for (int k = 0; k < rows; ++k) {
      const double* const b = B + static_cast<std::ptrdiff_t>(k) * stride + first;
      for (int lane = 0; lane < kQuad; ++lane) {
        sum[lane] += b[lane] * r[k];
      }
    }
    for (int lane = 0; lane < std::min(kQuad, width - first); ++lane) {
      x[first + lane] += sum[lane];
    }
  }
}

// y += sign B q.
void AddProduct(const double* B, int rows, int stride, int width, const double* q, double sign,
                double* y) {
  for (int k = 0; k < rows; ++k) {
    const double* const b = B + static_cast<std::ptrdiff_t>(k) * stride;
    y[k] += sign * std::inner_product(b, b + width, q, 0.0);
  }
}

}  // namespace

CoarseColumns::CoarseColumns(const std::vector<int>& offsets, CoarseShape shape,
                             const Executor& executor)
    : executor_(executor), shape_(std::move(shape)), offsets_(offsets), column_offsets_{0} {
  for (const int width : shape_.widths) {
    column_offsets_.push_back(column_offsets_.back() + width);
  }
  PlaceValues();
  PlaceProducts();
}

// V has one block a row of A, in the columns of the row's aggregate: rows of widths[aggregate]
// entries, padded to quads. The members of each aggregate are listed, ascending, for the sums VᵀA
// V.
void CoarseColumns::PlaceValues() {
  padded_.push_back(0);
  V_begin_.push_back(0);
  for (int i = 0; i < num_rows(); ++i) {
    // Vectors begin each block row on a quad.
    padded_.push_back(padded_.back() + PadToQuad(block_size(i)));
    V_begin_.push_back(V_begin_.back() +
                       static_cast<std::int64_t>(block_size(i)) * stride(shape_.aggregate_of[i]));
  }
  const auto for_each_member = [this](const auto& add) {
    for (int i = 0; i < num_rows(); ++i) {
      add(shape_.aggregate_of[i], i);
    }
  };
  CountingSort(shape_.num_aggregates(), for_each_member, &members_begin_, &members_);
  // Zeros also in the padding, which nobody writes.
  V_ = ZeroedArray(V_begin_.back());
}

// A V has a block where the columns of an aggregate reach a row of A: by aggregate, as it is
// formed, and once more by row, since a product A V q is summed row by row, each by one task.
void CoarseColumns::PlaceProducts() {
  A_V_begin_.push_back(0);
  const auto for_each_product = [this](const auto& add) {
    for (int a = 0; a < shape_.num_aggregates(); ++a) {
      for (int place = shape_.coupled_begin[a]; place < shape_.coupled_begin[a + 1]; ++place) {
        add(shape_.coupled[place], RowPlace{a, place});
      }
    }
  };
  for_each_product([this](int row, const RowPlace& place) {
    A_V_begin_.push_back(A_V_begin_.back() +
                         static_cast<std::int64_t>(block_size(row)) * stride(place.aggregate));
  });
  // By ascending aggregate within a row: one order of the sum.
  CountingSort(num_rows(), for_each_product, &rows_begin_, &rows_);
  A_V_ = ZeroedArray(A_V_begin_.back());
}

// Block (a, b) is there if a row of aggregate a is reached by the columns of b.
BlockPattern CoarseColumns::GalerkinPattern() const {
  const int count = shape_.num_aggregates();
  std::vector<std::vector<int>> columns(count);  // per row, ascending
  std::vector<int> last_column(count, -1);
  for (int b = 0; b < count; ++b) {
    for (int place = shape_.coupled_begin[b]; place < shape_.coupled_begin[b + 1]; ++place) {
      // Of the lower triangle alone. The rows come in any order of aggregates, but those of one
      // column b are met together, so the last column of a row tells whether (a, b) is new.
      const int a = shape_.aggregate_of[shape_.coupled[place]];
      if (a > b && std::exchange(last_column[a], b) != b) {
        columns[a].push_back(b);
      }
    }
    // The diagonal block is always there, and last of those up to b, as a BlockPattern has it. Rows
    // behind b get theirs when the loop comes to them.
    columns[b].push_back(b);
  }
  BlockPattern pattern = PatternWithoutBlocks(column_offsets_);
  for (const std::vector<int>& of_row : columns) {
    AppendRow(of_row, &pattern);
  }
  return pattern;
}

int CoarseColumns::stride(int aggregate) const {
  return PadToQuad(shape_.widths[aggregate]);
}

// By bisection: the aggregates of a row are ascending.
int CoarseColumns::PlaceOf(int row, int aggregate) const {
  const auto first = rows_.begin() + rows_begin_[row];
  const auto last = rows_.begin() + rows_begin_[row + 1];
  const auto found = std::lower_bound(
      first, last, aggregate, [](const RowPlace& at, int wanted) { return at.aggregate < wanted; });
  return found != last && found->aggregate == aggregate ? found->place : -1;
}

void CoarseColumns::Orthonormalize(const std::vector<const double*>& blocks) {
  executor_.For(shape_.num_aggregates(), kAggregateGrain, [&](int begin, int end) {
    for (int a = begin; a < end; ++a) {
      OrthonormalizeAggregate(a, blocks);
    }
  });
}

// v_aᵀ N v_b.
// N is block diagonal by rows of A, so the product takes the blocks of the aggregate's own rows.
double CoarseColumns::Product(int aggregate, int a, int b,
                              const std::vector<const double*>& blocks) const {
  const int stride = this->stride(aggregate);
  double sum = 0.0;
  for (int m = members_begin_[aggregate]; m < members_begin_[aggregate + 1]; ++m) {
    const int row = members_[m];
    const int size = block_size(row);
    const double* const v = V(row);
    const double* N = blocks[row];
    for (int r = 0; r < size; ++r, N += size) {
      double N_v = 0.0;
      for (int c = 0; c < size; ++c) {
        N_v += N[c] * v[c * stride + b];
      }
      sum += v[r * stride + a] * N_v;
    }
  }
  return sum;
}

// Gram and Schmidt, modified, twice.
// In the norm of N, aggregate by aggregate: columns of different aggregates share no row and are
// orthogonal already. A second pass removes what cancellation in the first leaves. A column that
// loses all but 1e-7 of its length is rounding of what it depended on; zeros keep its place, so
// that the shape stays, and CoarseFactor gives it a pivot of 1.
void CoarseColumns::OrthonormalizeAggregate(int aggregate,
                                            const std::vector<const double*>& blocks) {
  const int stride = this->stride(aggregate);
  const auto for_each_row = [&](const auto& visit) {
    for (int m = members_begin_[aggregate]; m < members_begin_[aggregate + 1]; ++m) {
      double* v = V(members_[m]);
      for (int r = 0; r < block_size(members_[m]); ++r, v += stride) {
        visit(v);
      }
    }
  };
  // v_to := keep v_to + scale v_from.
  const auto add = [&](double scale, int from, double keep, int to) {
    for_each_row([=](double* v) { v[to] = keep * v[to] + scale * v[from]; });
  };
  for (int k = 0; k < shape_.widths[aggregate]; ++k) {
    // A length of rounding alone may be the root of a negative number.
    const double length = std::sqrt(std::max(0.0, Product(aggregate, k, k, blocks)));
    for (int pass = 0; pass < 2; ++pass) {
      for (int earlier = 0; earlier < k; ++earlier) {
        add(-Product(aggregate, earlier, k, blocks), earlier, 1.0, k);
      }
    }
    const double left = std::sqrt(std::max(0.0, Product(aggregate, k, k, blocks)));
    // The inverse may be infinite where the length is not zero.
    const bool independent = left > kDependent * length && std::isfinite(1.0 / left);
    if (independent) {
      add(0.0, k, 1.0 / left, k);
    } else {
      // Not by a product, which leaves what is no number.
      for_each_row([k](double* v) { v[k] = 0.0; });
    }
  }
}

// VᵀA V from V and A V. A task writes the blocks of its own columns, whatever their row.
void CoarseColumns::FormGalerkin(const BlockPattern& pattern, double* values) const {
  std::fill_n(values, pattern.value_begin.back(), 0.0);
  executor_.For(shape_.num_aggregates(), kAggregateGrain, [&](int begin, int end) {
    for (int a = begin; a < end; ++a) {
      FormColumn(a, pattern, values);
    }
  });
}

// The blocks of VᵀA V in one column of aggregates.
// Block (a', a) = Σ V_iᵀ (A V)_ia over the rows i of a' that the columns of a reach. The lower
// triangle is enough: a' ≥ a. Of the diagonal block all is summed, as a BlockPattern has it.
void CoarseColumns::FormColumn(int aggregate, const BlockPattern& pattern, double* values) const {
  const int width = shape_.widths[aggregate];
  for (int place = shape_.coupled_begin[aggregate]; place < shape_.coupled_begin[aggregate + 1];
       ++place) {
    const int row = shape_.coupled[place];
    const int other = shape_.aggregate_of[row];
    if (other < aggregate) {
      continue;
    }
    // The pattern has the block, as GalerkinPattern lists all that are reached.
    double* const out = values + pattern.value_begin[FindBlock(pattern, other, aggregate)];
    const double* const av = AV(place);
    const double* const v = V(row);
    const int v_stride = stride(other), av_stride = stride(aggregate);
    for (int r = 0; r < block_size(row); ++r) {
      for (int i = 0; i < shape_.widths[other]; ++i) {
        for (int j = 0; j < width; ++j) {
          out[i * width + j] += v[r * v_stride + i] * av[r * av_stride + j];
        }
      }
    }
  }
}

// By aggregates: the members of each are listed.
void CoarseColumns::Restrict(const double* r, double* x) const {
  std::fill_n(x, column_offsets_.back(), 0.0);
  executor_.For(shape_.num_aggregates(), kAggregateGrain, [&](int begin, int end) {
    for (int a = begin; a < end; ++a) {
      for (int m = members_begin_[a]; m < members_begin_[a + 1]; ++m) {
        const int row = members_[m];
        AddTransposed(V(row), block_size(row), stride(a), shape_.widths[a], r + padded_[row],
                      x + column_offsets_[a]);
      }
    }
  });
}

// By aggregates, whose blocks of A V follow each other.
void CoarseColumns::RestrictProducts(const double* z, double* x) const {
  std::fill_n(x, column_offsets_.back(), 0.0);
  executor_.For(shape_.num_aggregates(), kAggregateGrain, [&](int begin, int end) {
    for (int a = begin; a < end; ++a) {
      for (int place = shape_.coupled_begin[a]; place < shape_.coupled_begin[a + 1]; ++place) {
        const int row = shape_.coupled[place];
        AddTransposed(AV(place), block_size(row), stride(a), shape_.widths[a], z + padded_[row],
                      x + column_offsets_[a]);
      }
    }
  });
}

// By rows, through rows_: by aggregates several tasks would add to one row.
void CoarseColumns::SubtractProducts(const double* q, const double* r, double* y) const {
  executor_.For(num_rows(), kCoarseRowGrain, [&](int begin, int end) {
    for (int row = begin; row < end; ++row) {
      std::copy(r + padded_[row], r + padded_[row + 1], y + padded_[row]);
      for (int k = rows_begin_[row]; k < rows_begin_[row + 1]; ++k) {
        const int a = rows_[k].aggregate;
        AddProduct(AV(rows_[k].place), block_size(row), stride(a), shape_.widths[a],
                   q + column_offsets_[a], -1.0, y + padded_[row]);
      }
    }
  });
}

// A row has one aggregate, so each entry of z is written once.
void CoarseColumns::Prolong(const double* q, double* z) const {
  executor_.For(num_rows(), kCoarseRowGrain, [&](int begin, int end) {
    for (int row = begin; row < end; ++row) {
      const int a = shape_.aggregate_of[row];
      AddProduct(V(row), block_size(row), stride(a), shape_.widths[a], q + column_offsets_[a], 1.0,
                 z + padded_[row]);
    }
  });
}

// Six arrays are about as long as the offsets.
std::int64_t CoarseColumns::Bytes() const {
  return static_cast<std::int64_t>((V_.size() + A_V_.size()) * sizeof(double) +
                                   rows_.size() * sizeof(RowPlace) +
                                   (shape_.coupled.size() + offsets_.size() * 6) * sizeof(int));
}

}  // namespace inceres::internal
