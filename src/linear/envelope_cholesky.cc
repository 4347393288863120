#include "linear/envelope_cholesky.h"

#include <algorithm>
#include <cmath>
#include <string>

namespace inceres::internal {
namespace {

// X := X L⁻ᵀ for a rows × size block X left of the lower triangular diagonal block L; both row-major.
void SolveAgainstDiagonal(int rows, int size, const double* L, int ldl, double* X, int ldx) {
  for (int r = 0; r < rows; ++r, X += ldx) {
    for (int c = 0; c < size; ++c) {
      double sum = X[c];
      for (int k = 0; k < c; ++k) {
        sum -= X[k] * L[c * ldl + k];
      }
      X[c] = sum / L[c * ldl + c];
    }
  }
}

// In-place Cholesky of a small block's lower triangle. False at a pivot that is not positive and finite.
bool FactorDiagonal(int size, double* A, int lda) {
  for (int i = 0; i < size; ++i) {
    for (int j = 0; j <= i; ++j) {
      double sum = A[i * lda + j];
      for (int k = 0; k < j; ++k) {
        sum -= A[i * lda + k] * A[j * lda + k];
      }
      if (i > j) {
        A[i * lda + j] = sum / A[j * lda + j];
      } else if (sum > 0.0 && std::isfinite(sum)) {
        A[i * lda + i] = std::sqrt(sum);
      } else {
        return false;
      }
    }
  }
  return true;
}

}  // namespace

Status EnvelopeCholesky::Factorize(const SymmetricBlockRows& S, const double* damping, int first_changed) {
  const int first = std::min(first_changed, num_valid_rows_);
  rows_.resize(S.num_rows());
  offsets_.resize(first + 1);
  for (int i = first; i < S.num_rows(); ++i) {
    offsets_.push_back(offsets_.back() + S.size_of(i));
  }
  num_valid_rows_ = first;
  for (int i = first; i < S.num_rows(); ++i) {
    CopyRow(S, damping, i);
    if (!FactorRow(i)) {
      return Status::Error(StatusCode::kSingular,
                           "the reduced system is not positive definite at block row " + std::to_string(i));
    }
    num_valid_rows_ = i + 1;
  }
  return Status::Ok();
}

void EnvelopeCholesky::CopyRow(const SymmetricBlockRows& S, const double* damping, int i) {
  Row& row = rows_[i];
  const auto& entries = S.row(i);
  const int size = BlockSize(i);
  row.start = entries.empty() ? offsets_[i] : offsets_[entries.front().column] / kQuad * kQuad;
  row.stride = PadToQuad(offsets_[i + 1] - row.start);
  row.values.assign(static_cast<std::size_t>(size) * row.stride, 0.0);
  for (const SymmetricBlockRows::Entry& entry : entries) {
    const int columns = BlockSize(entry.column);
    const double* block = S.values(entry.offset);
    double* out = row.values.data() + offsets_[entry.column] - row.start;
    for (int r = 0; r < size; ++r) {
      std::copy_n(block + r * PadToQuad(columns), columns, out + static_cast<std::ptrdiff_t>(r) * row.stride);
    }
  }
  for (int r = 0; r < size; ++r) {
    row.values[static_cast<std::size_t>(r) * row.stride + (offsets_[i] + r - row.start)] += damping[offsets_[i] + r];
  }
}

bool EnvelopeCholesky::FactorRow(int i) {
  const Kernels& kernels = BestKernels();
  Row& row = rows_[i];
  const int size = BlockSize(i);
  const auto first_block = std::upper_bound(offsets_.begin(), offsets_.begin() + i + 1, row.start) - offsets_.begin() - 1;
  for (int j = static_cast<int>(first_block); j < i; ++j) {
    const Row& other = rows_[j];
    const int columns = BlockSize(j);
    if (columns == 0 || offsets_[j] < row.start) {
      continue;  // a removed row, or one that ends in the alignment gap before this row's first block
    }
    const int begin = std::max(row.start, other.start);
    double* block = row.values.data() + offsets_[j] - row.start;
    kernels.subtract_row_dots(size, columns, offsets_[j] - begin, row.values.data() + begin - row.start, row.stride,
                              other.values.data() + begin - other.start, other.stride, block, row.stride);
    SolveAgainstDiagonal(size, columns, other.values.data() + offsets_[j] - other.start, other.stride, block, row.stride);
  }
  double* diagonal = row.values.data() + offsets_[i] - row.start;
  kernels.subtract_row_dots(size, size, offsets_[i] - row.start, row.values.data(), row.stride, row.values.data(), row.stride,
                            diagonal, row.stride);
  return FactorDiagonal(size, diagonal, row.stride);
}

void EnvelopeCholesky::Solve(const double* b, double* x) const {
  const int num_rows = static_cast<int>(rows_.size());
  std::copy(b, b + offsets_.back(), x);
  for (int i = 0; i < num_rows; ++i) {
    const Row& row = rows_[i];
    for (int r = offsets_[i]; r < offsets_[i + 1]; ++r) {
      const double* L = row.values.data() + static_cast<std::ptrdiff_t>(r - offsets_[i]) * row.stride - row.start;
      double sum = x[r];
      for (int k = row.start; k < r; ++k) {
        sum -= L[k] * x[k];
      }
      x[r] = sum / L[r];
    }
  }
  for (int i = num_rows - 1; i >= 0; --i) {
    const Row& row = rows_[i];
    for (int r = offsets_[i + 1] - 1; r >= offsets_[i]; --r) {
      const double* L = row.values.data() + static_cast<std::ptrdiff_t>(r - offsets_[i]) * row.stride - row.start;
      x[r] /= L[r];
      for (int k = row.start; k < r; ++k) {
        x[k] -= L[k] * x[r];
      }
    }
  }
}

std::int64_t EnvelopeCholesky::NumEntries() const {
  std::int64_t entries = 0;
  for (const Row& row : rows_) {
    entries += static_cast<std::int64_t>(row.values.size());
  }
  return entries;
}

}  // namespace inceres::internal
