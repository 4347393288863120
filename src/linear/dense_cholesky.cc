#include "linear/dense_cholesky.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "block/kernels.h"

namespace inceres::internal {
namespace {

constexpr int kPanel = 16;
constexpr int kTriangle = 4;   // what of a panel is factored by hand
constexpr int kRowStrip = 96;  // rows a task: a multiple of every kernel's tile height, so tasks do not change the arithmetic
constexpr int kParallelSize = 128;  // smaller matrices are not worth waking a thread

}  // namespace

Status DenseCholesky::Analyze(const BlockPattern& pattern) {
  pattern_ = &pattern;
  size_ = pattern.size();
  padded_size_ = PadToQuad(size_);
  stride_ = padded_size_;
  // A power-of-two distance between columns would map them all to the same few cache sets.
  if (stride_ % 128 == 0) {
    stride_ += kQuad;
  }
  L_.assign(stride_ * static_cast<std::size_t>(size_), 0.0);
  solution_.assign(padded_size_, 0.0);
  return Status::Ok();
}

void DenseCholesky::CopyIn(const double* values, const double* diagonal) {
  for (int j = 0; j < size_; ++j) {
    std::fill(Column(j) + j / kPanel * kPanel, Column(j) + padded_size_, 0.0);
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

// Subtracts what the columns ahead of the panel contribute to it. The rows of the padding are zero and stay so: with them there
// is nothing left over for the kernels to do one by one.
void DenseCholesky::UpdatePanel(int first, int width) {
  const Kernels& kernels = BestKernels();
  const int rows = padded_size_ - first;
  const int num_strips = (rows + kRowStrip - 1) / kRowStrip;
  executor_.For(size_ >= kParallelSize ? num_strips : 1, 1, [&](int begin, int end) {
    const int top = begin * kRowStrip;
    const int bottom = size_ >= kParallelSize ? std::min(end * kRowStrip, rows) : rows;
    kernels.subtract_outer(bottom - top, width, first, L_.data() + first + top, stride_, L_.data() + first, stride_,
                           Column(first) + first + top, stride_);
  });
}

bool DenseCholesky::FactorTriangle(int first, int width, int* failed) {
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

// Right-looking: a small triangle, the rows below it, what they take from the rest of the block.
bool DenseCholesky::FactorDiagonalBlock(int first, int width, int* failed) {
  const Kernels& kernels = BestKernels();
  for (int j = first; j < first + width; j += kTriangle) {
    const int size = std::min(kTriangle, first + width - j);
    const int below = j + size;
    const int rows = first + width - below;
    if (!FactorTriangle(j, size, failed)) {
      return false;
    }
    if (rows > 0) {
      const double* left = Column(j) + below;
      kernels.solve_lower_transposed(rows, size, Column(j) + j, stride_, Column(j) + below, stride_);
      kernels.subtract_outer(rows, rows, size, left, stride_, left, stride_, Column(below) + below, stride_);
    }
  }
  return true;
}

void DenseCholesky::SolvePanel(int first, int width) {
  const int below = first + width;
  if (below < size_) {
    BestKernels().solve_lower_transposed(padded_size_ - below, width, Column(first) + first, stride_, Column(first) + below,
                                         stride_);
  }
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

// A panel at a time: its own triangle by hand, what is below by a kernel.
Status DenseCholesky::Solve(const double* b, double* x) {
  const Kernels& kernels = BestKernels();
  double* y = solution_.data();
  std::copy(b, b + size_, y);
  for (int first = 0; first < size_; first += kPanel) {
    const int below = std::min(first + kPanel, size_);
    for (int j = first; j < below; ++j) {
      const double* column = Column(j);
      y[j] /= column[j];
      for (int i = j + 1; i < below; ++i) {
        y[i] -= column[i] * y[j];
      }
    }
    if (below < size_) {
      kernels.subtract_outer(padded_size_ - below, 1, below - first, Column(first) + below, stride_, y + first, 1, y + below,
                             padded_size_);
    }
  }
  for (int first = (size_ - 1) / kPanel * kPanel; first >= 0; first -= kPanel) {
    const int below = std::min(first + kPanel, size_);
    if (below < size_) {
      kernels.subtract_row_dots(below - first, 1, size_ - below, Column(first) + below, stride_, y + below, size_, y + first, 1);
    }
    for (int j = below - 1; j >= first; --j) {
      const double* column = Column(j);
      for (int i = j + 1; i < below; ++i) {
        y[j] -= column[i] * y[i];
      }
      y[j] /= column[j];
    }
  }
  std::copy(y, y + size_, x);
  return Status::Ok();
}

}  // namespace inceres::internal
