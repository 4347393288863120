#include "linear/assembled_matrix.h"

#include <algorithm>

#include "base/growth_count.h"
#include "simd/kernels.h"

namespace inceres::internal {

// A copy of the values of S and of its diagonal as they were assembled into a factor. The Bayes
// tree (docs/algorithms.md, "Reduced linear systems") asks block by block what has become another
// since, and only what has makes a clique stale. The comparison is one of values: a row that was
// summed anew with the same result costs nothing. An entry that is NaN is unlike itself and so
// always counts as changed, which is the safe side.
//
// The copy has the layout of SymmetricBlockRows, offset by offset, padding included. Where a block
// takes up the room of a removed one, the copy has the values of the latter until Take. So of each
// room it is known which block they are of: two blocks that went and came back may have traded
// their rooms, and the neighbors of their rows tell nothing of it.

namespace {

std::size_t LengthOf(const SymmetricBlockRows& S, int row, int column) {
  return static_cast<std::size_t>(S.size_of(row)) * PadToQuad(S.size_of(column));
}

}  // namespace

// Beyond the end of the copy nothing has been taken yet. The values of another block count for
// nothing, even where they are the same. A block that is left out (a held row) stands for zeros, so
// that holding and freeing a row shows as a change of its blocks.
bool AssembledMatrix::Has(const SymmetricBlockRows& S, int row,
                          const SymmetricBlockRows::Entry& block, bool left_out) const {
  const std::size_t length = LengthOf(S, row, block.column);
  if (values_.size() < static_cast<std::size_t>(block.offset) + length) {
    return false;
  }
  const Name& name = names_[block.offset / kQuad];
  if (name.row != row || name.column != block.column) {
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
    names_.resize(end / kQuad);
    values_.resize(end);
  }
  names_[block.offset / kQuad] = {row, block.column};
  // Whole quads, of a block that is mostly too small for a library call to be worthwhile.
  double* const taken = values_.data() + block.offset;
  const double* const values = S.values(block.offset);
  for (std::size_t k = 0; k < length; k += kQuad) {
    for (std::size_t i = k; i < k + kQuad; ++i) {
      taken[i] = left_out ? 0.0 : values[i];
    }
  }
}

// By rows of S, since a row's damping may change where its blocks do not. A row that was taken with
// another size is unequal by its length.
bool AssembledMatrix::HasDiagonal(int row, const double* diagonal, int size) const {
  return row < static_cast<int>(diagonals_.size()) &&
         std::equal(diagonals_[row].begin(), diagonals_[row].end(), diagonal, diagonal + size);
}

void AssembledMatrix::TakeDiagonal(int row, const double* diagonal, int size) {
  if (row >= static_cast<int>(diagonals_.size())) {
    diagonals_.resize(static_cast<std::size_t>(row) + 1);
  }
  const GrowthCount growth(diagonals_[row], &list_bytes_);
  diagonals_[row].assign(diagonal, diagonal + size);
}

std::size_t AssembledMatrix::Bytes() const {
  return values_.capacity() * sizeof(double) + names_.capacity() * sizeof(Name) +
         diagonals_.size() * sizeof(std::vector<double>) + list_bytes_;
}

}  // namespace inceres::internal
