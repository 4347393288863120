#include "linear/dense_cholesky.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "block/kernels.h"

namespace inceres::internal {
namespace {

constexpr int kPanel = 16;
constexpr int kRowStrip = 96;  // rows a task: a multiple of every kernel's tile height, so tasks do not change the arithmetic
constexpr int kParallelSize = 128;  // smaller matrices are not worth waking a thread

}  // namespace

Status DenseCholesky::Analyze(const BlockPattern& pattern) {
  pattern_ = &pattern;
  size_ = pattern.size();
  stride_ = PadToQuad(size_);
  // A power-of-two distance between columns would map them all to the same few cache sets.
  if (stride_ % 128 == 0) {
    stride_ += kQuad;
  }
  L_.assign(stride_ * static_cast<std::size_t>(size_), 0.0);
  return Status::Ok();
}

void DenseCholesky::CopyIn(const double* values, const double* diagonal) {
  for (int j = 0; j < size_; ++j) {
    std::fill(Column(j) + j / kPanel * kPanel, Column(j) + size_, 0.0);
  }
  for (int row = 0; row < pattern_->num_blocks(); ++row) {
    const int rows = pattern_->block_size(row);
    const int first_row = pattern_->offsets[row];
    for (int k = pattern_->row_begin[row]; k < pattern_->row_begin[row + 1]; ++k) {
      const int column = pattern_->columns[k];
      const int columns = pattern_->block_size(column);
      const double* block = values + pattern_->value_begin[k];
      for (int c = 0; c < columns; ++c) {
        double* out = Column(pattern_->offsets[column] + c) + first_row;
        for (int r = row == column ? c : 0; r < rows; ++r) {
          out[r] = block[r * columns + c];
        }
      }
    }
  }
  for (int j = 0; j < size_; ++j) {
    Column(j)[j] += diagonal[j];
  }
}

// Subtracts what the columns ahead of the panel contribute to it.
void DenseCholesky::UpdatePanel(int first, int width) {
  const Kernels& kernels = BestKernels();
  const int rows = size_ - first;
  const int num_strips = (rows + kRowStrip - 1) / kRowStrip;
  executor_.For(size_ >= kParallelSize ? num_strips : 1, 1, [&](int begin, int end) {
    const int top = begin * kRowStrip;
    const int bottom = size_ >= kParallelSize ? std::min(end * kRowStrip, rows) : rows;
    kernels.subtract_outer(bottom - top, width, first, L_.data() + first + top, stride_, L_.data() + first, stride_,
                           Column(first) + first + top, stride_);
  });
}

bool DenseCholesky::FactorDiagonalBlock(int first, int width, int* failed) {
  for (int j = first; j < first + width; ++j) {
    double* column = Column(j);
    for (int k = first; k < j; ++k) {
      const double* other = Column(k);
      for (int i = j; i < first + width; ++i) {
        column[i] -= other[i] * other[j];
      }
    }
    if (!(column[j] > 0.0) || !std::isfinite(column[j])) {
      *failed = j;
      return false;
    }
    const double root = std::sqrt(column[j]);
    column[j] = root;
    for (int i = j + 1; i < first + width; ++i) {
      column[i] /= root;
    }
  }
  return true;
}

void DenseCholesky::SolvePanel(int first, int width) {
  const int below = first + width;
  BestKernels().solve_lower_transposed(size_ - below, width, Column(first) + first, stride_, Column(first) + below, stride_);
}

Status DenseCholesky::Factorize(const double* values, const double* diagonal) {
  CopyIn(values, diagonal);
  for (int first = 0; first < size_; first += kPanel) {
    const int width = std::min(kPanel, size_ - first);
    int failed = 0;
    UpdatePanel(first, width);
    if (!FactorDiagonalBlock(first, width, &failed)) {
      const auto block =
          std::upper_bound(pattern_->offsets.begin(), pattern_->offsets.end(), failed) - pattern_->offsets.begin() - 1;
      return Status::Error(StatusCode::kSingular,
                           "the reduced system is not positive definite at frame " + std::to_string(block));
    }
    SolvePanel(first, width);
  }
  return Status::Ok();
}

Status DenseCholesky::Solve(const double* b, double* x) {
  std::copy(b, b + size_, x);
  for (int j = 0; j < size_; ++j) {
    const double* column = Column(j);
    x[j] /= column[j];
    for (int i = j + 1; i < size_; ++i) {
      x[i] -= column[i] * x[j];
    }
  }
  for (int j = size_ - 1; j >= 0; --j) {
    const double* column = Column(j);
    double sum = x[j];
    for (int i = j + 1; i < size_; ++i) {
      sum -= column[i] * x[i];
    }
    x[j] = sum / column[j];
  }
  return Status::Ok();
}

}  // namespace inceres::internal
