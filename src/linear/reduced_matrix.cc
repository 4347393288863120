#include "inceres/linear/reduced_matrix.h"

#include "linear/block_rows.h"

namespace inceres {

// The half of ReducedMatrix that knows S as it grows. A pattern of it numbers living rows without
// gaps; ids are the numbers that rows have for good.

int ReducedMatrix::RowId(int i) const {
  return rows_ == nullptr ? i : rows_->pattern_rows()[i];
}

const BlockPattern& ReducedMatrix::GrownPattern() const {
  return rows_->Pattern();
}

const double* ReducedMatrix::GrownBlock(int i, int k) const {
  const BlockPattern& blocks = rows_->Pattern();
  // A held row keeps its place in the pattern, as a row of the identity: its blocks are not shown.
  const bool left_out = constant_ != nullptr &&
                        (constant_[RowId(i)] != 0 || constant_[RowId(blocks.columns[k])] != 0);
  return left_out ? nullptr : rows_->values(blocks.value_begin[k]);
}

}  // namespace inceres
