#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "base/executor.h"
#include "base/zeroed_array.h"
#include "inceres/linear/reduced_matrix.h"
#include "inceres/status.h"
#include "linear/sparse_cholesky.h"

namespace inceres::internal {

/// What a coarse space is made of: block rows of A in aggregates, each with a few columns of V.
struct CoarseShape {
  std::vector<int> aggregate_of;  // per block row of A
  std::vector<int> widths;        // per aggregate: its columns of V
  // per aggregate, and one more: the block rows of A V that its columns reach, ascending, with its
  // own ones among them
  std::vector<int> coupled_begin;
  std::vector<int> coupled;

  int num_aggregates() const { return static_cast<int>(widths.size()); }
};

/// The coarse half of a two-level preconditioner for a symmetric positive definite A: V, which has
/// a block row for each of A, in the columns of its aggregate; A V; and the Cholesky factor of the
/// Galerkin product VᵀA V. Others write V and A V.
///
/// Vectors are padded: each block row starts on a quad. Rows of blocks of V and A V are padded to
/// quads; the padding stays zero. Threads: the executor's; the same bits for any number. Memory:
/// A V, and the factor.
class CoarseSpace {
 public:
  /// `offsets`: first scalar of each block row of A, and the total. Fails as the analysis of the
  /// coarse matrix.
  CoarseSpace(const std::vector<int>& offsets, CoarseShape shape, const Executor& executor,
              Status* status);

  const CoarseShape& shape() const { return shape_; }
  int block_size(int row) const { return offsets_[row + 1] - offsets_[row]; }
  /// From row to row of a block of an aggregate.
  int stride(int aggregate) const;
  double* V(int row) { return V_.data() + V_begin_[row]; }
  const double* V(int row) const { return V_.data() + V_begin_[row]; }
  /// The block at a place of shape().coupled.
  double* AV(int place) { return A_V_.data() + A_V_begin_[place]; }

  /// Makes the columns of each aggregate orthonormal in the norm of N = blockdiag(blocks), one
  /// square block a row; a column that the ones before it hold is set to zero.
  void Orthonormalize(const std::vector<const double*>& blocks);
  /// VᵀA V and its factor. What rounding has left of it is made positive definite.
  Status Factorize();

  /// y = r − A V q with q = (VᵀA V)⁻¹ Vᵀ r, which is kept.
  void Deflate(const double* r, double* y);
  /// z += V (q − (VᵀA V)⁻¹ (A V)ᵀ z).
  void AddCoarse(double* z);

  std::int64_t Bytes() const;

 private:
  struct ColumnBlock {
    int row;    // aggregate
    int block;  // of the coarse pattern
  };
  // a block of A V, seen from its row
  struct RowPlace {
    int aggregate;
    int place;
  };
  void PlaceValues();
  void PlaceProducts();
  void BuildPattern();
  void FindColumns();
  void OrthonormalizeAggregate(int aggregate, const std::vector<const double*>& blocks);
  double Product(int aggregate, int a, int b, const std::vector<const double*>& blocks) const;
  void FormColumn(int aggregate);

  const Executor& executor_;
  const CoarseShape shape_;
  std::vector<int> offsets_;
  std::vector<int> padded_;
  std::vector<int> members_begin_;  // per aggregate, one more
  std::vector<int> members_;        // block rows, ascending
  std::vector<int> rows_begin_;     // per block row, one more
  std::vector<RowPlace> rows_;
  std::vector<std::int64_t> V_begin_;
  std::vector<std::int64_t> A_V_begin_;
  ZeroedArray V_;
  ZeroedArray A_V_;
  BlockPattern pattern_;           // of VᵀA V
  std::vector<int> column_begin_;  // per aggregate, one more
  std::vector<ColumnBlock> column_blocks_;
  std::vector<double> values_;
  std::vector<double> diagonal_;
  SparseCholesky factor_;
  std::vector<double> restricted_;  // packed by aggregate, as all that is coarse
  std::vector<double> q_;
  std::vector<double> correction_;
};

}  // namespace inceres::internal
