#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "inceres/linear/reduced_matrix.h"
#include "linear/block_rows.h"

namespace inceres::internal {

/// The A = S + diag that a factor was made of, block by block, for who wants to know what has
/// become another since: to the bit, so that rows that were only summed anew do not count. A block
/// that has come to the room of another one is not it, whatever its values are.
class AssembledMatrix {
 public:
  /// A block that is left out counts as zeros.
  bool Has(const SymmetricBlockRows& S, int row, const SymmetricBlockRows::Entry& block,
           bool left_out) const;
  void Take(const SymmetricBlockRows& S, int row, const SymmetricBlockRows::Entry& block,
            bool left_out);
  /// A block that was taken, padded as S has it.
  const double* Values(std::int64_t offset) const { return values_.data() + offset; }
  /// The row's `size` entries of the diagonal.
  bool HasDiagonal(int row, const double* diagonal, int size) const;
  void TakeDiagonal(int row, const double* diagonal, int size);
  std::size_t Bytes() const;

 private:
  struct Name {
    int row = -1;
    int column = -1;
  };

  std::vector<double> values_;  // where S has them
  std::vector<Name> names_;     // per quad of these: at the first of a block, the block
  std::vector<std::vector<double>> diagonals_;
  std::size_t list_bytes_ = 0;  // of these
};

}  // namespace inceres::internal
