#pragma once

#include <cstddef>
#include <vector>

#include "linear/block_rows.h"
#include "linear/seen_rows.h"

namespace inceres::internal {

/// Where the rows of an S that is edited begin in vectors packed by rows.
class RowPacking {
 public:
  /// Takes over what has come, gone or got another size. True if a row that was known before begins
  /// elsewhere now. Cost: the rows that have come, as long as none has gone.
  bool Follow(const SymmetricBlockRows& S) {
    const std::size_t known = offsets_.size() - 1, count = static_cast<std::size_t>(S.num_rows());
    const bool only_new = seen_.OnlyGrew(S) && known <= count;
    offsets_.resize(count + 1);
    bool has_moved = false;
    for (std::size_t row = only_new ? known : 0; row < count; ++row) {
      const int end = offsets_[row] + S.size_of(static_cast<int>(row));
      has_moved |= row < known && offsets_[row + 1] != end;
      offsets_[row + 1] = end;
    }
    return has_moved;
  }

  int operator[](int row) const { return offsets_[static_cast<std::size_t>(row)]; }
  int size() const { return offsets_.back(); }
  int num_rows() const { return static_cast<int>(offsets_.size()) - 1; }

 private:
  std::vector<int> offsets_{0};  // by row, one more: the size
  SeenRows seen_;
};

}  // namespace inceres::internal
