#pragma once

#include <cstddef>
#include <vector>

#include "base/aligned_vector.h"
#include "inceres/linear/reduced_solver.h"
#include "linear/block_rows.h"

namespace inceres::internal {

/// The diagonal blocks M_i of an A that grows and their inverses, kept while they do not change.
/// Vectors are padded: each block row starts on a quad, the padding is zero. Held rows have no
/// block.
class BlockJacobi {
 public:
  static constexpr int kNone = -1;

  /// Inverts the blocks that changed. Returns a block row whose M_i is not positive definite, which
  /// is tried again next time; kNone: there is none.
  int Update(const ReducedMatrix& A, const ReducedSolver::Rows& changed);

  /// y −= M v.
  void SubtractProduct(const double* v, double* y) const;
  /// z = M⁻¹ r.
  void Apply(const double* r, double* z) const;

  int num_rows() const { return static_cast<int>(blocks_.size()); }
  bool IsFree(int row) const { return blocks_[row].size > 0; }
  /// First scalar of each block row, packed and padded; one more: the totals.
  const std::vector<int>& packed_offsets() const { return packed_; }
  const std::vector<int>& padded_offsets() const { return padded_; }
  /// Blocks inverted in the last Update.
  int num_inverted() const { return num_inverted_; }
  std::size_t Bytes() const;

 private:
  struct Block {
    int size = 0;  // 0: held, or a removed row
    AlignedVector<double> M;
    AlignedVector<double> minus_inverse;
  };

  void FindOffsets(const SymmetricBlockRows& S, int first_row);
  bool Invert(const ReducedMatrix& A, int row);

  std::vector<Block> blocks_;
  std::vector<int> packed_{0};
  std::vector<int> padded_{0};
  AlignedVector<double> L_;  // workspace
  AlignedVector<double> inverse_pivots_;
  std::vector<int> stale_;  // block rows to be inverted
  int num_inverted_ = 0;
};

}  // namespace inceres::internal
