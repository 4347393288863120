#include "linear/assembled_matrix.h"

#include <algorithm>

#include "simd/kernels.h"

namespace inceres::internal {
namespace {

std::size_t LengthOf(const SymmetricBlockRows& S, int row, int column) {
  return static_cast<std::size_t>(S.size_of(row)) * PadToQuad(S.size_of(column));
}

}  // namespace

bool AssembledMatrix::Has(const SymmetricBlockRows& S, int row,
                          const SymmetricBlockRows::Entry& block, bool left_out) const {
  const std::size_t length = LengthOf(S, row, block.column);
  if (values_.size() < static_cast<std::size_t>(block.offset) + length) {
    return false;
  }
  const double* taken = values_.data() + block.offset;
  return left_out ? std::all_of(taken, taken + length, [](double value) { return value == 0.0; })
                  : std::equal(taken, taken + length, S.values(block.offset));
}

void AssembledMatrix::Take(const SymmetricBlockRows& S, int row,
                           const SymmetricBlockRows::Entry& block, bool left_out) {
  const std::size_t length = LengthOf(S, row, block.column);
  const auto end = static_cast<std::size_t>(block.offset) + length;
  if (values_.size() < end) {
    values_.resize(end);
  }
  if (left_out) {
    std::fill_n(values_.begin() + block.offset, length, 0.0);
  } else {
    std::copy_n(S.values(block.offset), length, values_.begin() + block.offset);
  }
}

bool AssembledMatrix::HasDiagonal(int row, const double* diagonal, int size) const {
  return row < static_cast<int>(diagonals_.size()) &&
         std::equal(diagonals_[row].begin(), diagonals_[row].end(), diagonal, diagonal + size);
}

void AssembledMatrix::TakeDiagonal(int row, const double* diagonal, int size) {
  if (row >= static_cast<int>(diagonals_.size())) {
    diagonals_.resize(static_cast<std::size_t>(row) + 1);
  }
  diagonals_[row].assign(diagonal, diagonal + size);
}

std::size_t AssembledMatrix::Bytes() const {
  std::size_t bytes = values_.capacity() * sizeof(double);
  for (const std::vector<double>& diagonal : diagonals_) {
    bytes += sizeof(std::vector<double>) + diagonal.capacity() * sizeof(double);
  }
  return bytes;
}

}  // namespace inceres::internal
