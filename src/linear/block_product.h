#pragma once

#include <cstdint>
#include <vector>

#include "base/executor.h"
#include "linear/block_neighbors.h"

namespace inceres::internal {

/// Products with a symmetric A of which the blocks of a pattern are stored, the lower triangle.
/// Vectors are padded: each block row starts on a quad. A row of the result is summed by one task,
/// by ascending columns: the same bits for any number of threads.
class BlockProduct {
 public:
  /// The pattern is only read here.
  explicit BlockProduct(const BlockPattern& pattern);

  /// y −= (A + diag(diagonal)) v. blocks[k]: the values of block k of the pattern, or null where
  /// they are zero; `diagonal` is packed. Cost: a pass over the blocks.
  void Subtract(const std::vector<const double*>& blocks, const double* diagonal,
                const Executor& executor, const double* v, double* y) const;
  /// y −= diag(diagonal) v.
  void SubtractDiagonal(const double* diagonal, const double* v, double* y) const;

  int num_rows() const { return static_cast<int>(packed_.size()) - 1; }
  int block_size(int row) const { return packed_[row + 1] - packed_[row]; }
  /// First scalar of each block row, packed and padded; one more: the totals.
  const std::vector<int>& packed_offsets() const { return packed_; }
  const std::vector<int>& padded_offsets() const { return padded_; }
  std::int64_t Bytes() const;

 private:
  void SubtractDiagonal(int row, const double* diagonal, const double* v, double* y) const;
  void SubtractRow(int row, const std::vector<const double*>& blocks, const double* diagonal,
                   const double* v, double* y) const;

  std::vector<int> packed_{0};
  std::vector<int> padded_{0};
  WholeRows rows_;
};

}  // namespace inceres::internal
