#include "linear/coarse_space.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "simd/kernels.h"

namespace inceres::internal {
namespace {

constexpr int kAggregateGrain = 4;
constexpr int kCoarseRowGrain = 64;
// A column that keeps less than this share of its length is one that the others hold.
constexpr double kDependent = 1e-7;
// Added to the diagonal of VᵀA V, whose columns of V have unit length in the norm of N: what
// rounding leaves of directions without curvature. More where it is not enough.
constexpr double kRegularization = 1e-13;
constexpr double kMoreRegularization = 1e3;
constexpr int kTrials = 4;

// x += Bᵀ r of a block of `rows` × `stride`, the first `width` columns.
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

CoarseSpace::CoarseSpace(const std::vector<int>& offsets, CoarseShape shape,
                         const Executor& executor, Status* status)
    : executor_(executor), shape_(std::move(shape)), offsets_(offsets), factor_(executor) {
  PlaceValues();
  PlaceProducts();
  BuildPattern();
  *status = factor_.Analyze(ReducedMatrix(pattern_, nullptr, nullptr));
}

int CoarseSpace::stride(int aggregate) const {
  return PadToQuad(shape_.widths[aggregate]);
}

void CoarseSpace::Orthonormalize(const std::vector<const double*>& blocks) {
  executor_.For(shape_.num_aggregates(), kAggregateGrain, [&](int begin, int end) {
    for (int a = begin; a < end; ++a) {
      OrthonormalizeAggregate(a, blocks);
    }
  });
}

// v_aᵀ N v_b.
double CoarseSpace::Product(int aggregate, int a, int b,
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
void CoarseSpace::OrthonormalizeAggregate(int aggregate, const std::vector<const double*>& blocks) {
  const int stride = this->stride(aggregate);
  const auto add = [&](double scale, int from, double keep, int to) {
    for (int m = members_begin_[aggregate]; m < members_begin_[aggregate + 1]; ++m) {
      double* v = V(members_[m]);
      for (int r = 0; r < block_size(members_[m]); ++r, v += stride) {
        v[to] = keep * v[to] + scale * v[from];
      }
    }
  };
  for (int k = 0; k < shape_.widths[aggregate]; ++k) {
    const double length = std::sqrt(std::max(0.0, Product(aggregate, k, k, blocks)));
    for (int pass = 0; pass < 2; ++pass) {
      for (int earlier = 0; earlier < k; ++earlier) {
        add(-Product(aggregate, earlier, k, blocks), earlier, 1.0, k);
      }
    }
    const double left = std::sqrt(std::max(0.0, Product(aggregate, k, k, blocks)));
    const bool independent = left > kDependent * length && std::isfinite(1.0 / left);
    add(0.0, k, independent ? 1.0 / left : 0.0, k);
  }
}

// The blocks of VᵀA V in one column of aggregates.
void CoarseSpace::FormColumn(int aggregate) {
  const int width = shape_.widths[aggregate];
  for (int k = column_begin_[aggregate]; k < column_begin_[aggregate + 1]; ++k) {
    const std::int64_t begin = pattern_.value_begin[column_blocks_[k].block];
    std::fill_n(values_.begin() + begin, shape_.widths[column_blocks_[k].row] * width, 0.0);
  }
  const auto first = column_blocks_.begin() + column_begin_[aggregate];
  const auto last = column_blocks_.begin() + column_begin_[aggregate + 1];
  for (int place = shape_.coupled_begin[aggregate]; place < shape_.coupled_begin[aggregate + 1];
       ++place) {
    const int row = shape_.coupled[place];
    const int other = shape_.aggregate_of[row];
    if (other < aggregate) {
      continue;
    }
    const auto found =
        std::lower_bound(first, last, other,
                         [](const ColumnBlock& block, int wanted) { return block.row < wanted; });
    double* const out = values_.data() + pattern_.value_begin[found->block];
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

Status CoarseSpace::Factorize() {
  executor_.For(shape_.num_aggregates(), kAggregateGrain, [&](int begin, int end) {
    for (int a = begin; a < end; ++a) {
      FormColumn(a);
    }
  });
  Status status;
  double regularization = kRegularization;
  for (int trial = 0; trial < kTrials; ++trial, regularization *= kMoreRegularization) {
    for (int a = 0; a < shape_.num_aggregates(); ++a) {
      const int width = shape_.widths[a];
      const double* const block =
          values_.data() + pattern_.value_begin[pattern_.row_begin[a + 1] - 1];
      for (int k = 0; k < width; ++k) {  // a column without entries stands for itself
        diagonal_[pattern_.offsets[a] + k] = block[k * width + k] == 0.0 ? 1.0 : regularization;
      }
    }
    status = factor_.Factorize(ReducedMatrix(pattern_, values_.data(), diagonal_.data()), {});
    if (status.ok()) {
      break;
    }
  }
  return status;
}

void CoarseSpace::Deflate(const double* r, double* y) {
  std::fill(restricted_.begin(), restricted_.end(), 0.0);
  executor_.For(shape_.num_aggregates(), kAggregateGrain, [&](int begin, int end) {
    for (int a = begin; a < end; ++a) {
      for (int m = members_begin_[a]; m < members_begin_[a + 1]; ++m) {
        const int row = members_[m];
        AddTransposed(V(row), block_size(row), stride(a), shape_.widths[a], r + padded_[row],
                      restricted_.data() + pattern_.offsets[a]);
      }
    }
  });
  static_cast<void>(factor_.Solve(restricted_.data(), {}, {}, q_.data()));  // it is factored
  const int num_rows = static_cast<int>(offsets_.size()) - 1;
  executor_.For(num_rows, kCoarseRowGrain, [&](int begin, int end) {
    for (int row = begin; row < end; ++row) {
      std::copy(r + padded_[row], r + padded_[row + 1], y + padded_[row]);
      for (int k = rows_begin_[row]; k < rows_begin_[row + 1]; ++k) {
        const int a = rows_[k].aggregate;
        AddProduct(AV(rows_[k].place), block_size(row), stride(a), shape_.widths[a],
                   q_.data() + pattern_.offsets[a], -1.0, y + padded_[row]);
      }
    }
  });
}

void CoarseSpace::AddCoarse(double* z) {
  std::fill(restricted_.begin(), restricted_.end(), 0.0);
  executor_.For(shape_.num_aggregates(), kAggregateGrain, [&](int begin, int end) {
    for (int a = begin; a < end; ++a) {
      for (int place = shape_.coupled_begin[a]; place < shape_.coupled_begin[a + 1]; ++place) {
        const int row = shape_.coupled[place];
        AddTransposed(AV(place), block_size(row), stride(a), shape_.widths[a], z + padded_[row],
                      restricted_.data() + pattern_.offsets[a]);
      }
    }
  });
  static_cast<void>(factor_.Solve(restricted_.data(), {}, {}, correction_.data()));
  for (std::size_t k = 0; k < q_.size(); ++k) {
    correction_[k] = q_[k] - correction_[k];
  }
  const int num_rows = static_cast<int>(offsets_.size()) - 1;
  executor_.For(num_rows, kCoarseRowGrain, [&](int begin, int end) {
    for (int row = begin; row < end; ++row) {
      const int a = shape_.aggregate_of[row];
      AddProduct(V(row), block_size(row), stride(a), shape_.widths[a],
                 correction_.data() + pattern_.offsets[a], 1.0, z + padded_[row]);
    }
  });
}

std::int64_t CoarseSpace::Bytes() const {
  return static_cast<std::int64_t>((V_.size() + A_V_.size() + values_.size() + 4 * q_.size()) *
                                       sizeof(double) +
                                   factor_.Bytes() + rows_.size() * sizeof(RowPlace) +
                                   (shape_.coupled.size() + offsets_.size() * 6) * sizeof(int));
}

}  // namespace inceres::internal
