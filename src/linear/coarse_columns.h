#pragma once

#include <cstdint>
#include <vector>

#include "base/executor.h"
#include "base/zeroed_array.h"
#include "inceres/linear/reduced_solver.h"

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

/// V, which has a block row for each of A, in the columns of its aggregate, and A V. Others write
/// both. Where several processes have some of the rows each, what comes out is their part of a sum.
///
/// Vectors over rows are padded: each block row starts on a quad. Vectors over columns are packed,
/// by aggregate. Rows of blocks of V and A V are padded to quads; the padding stays zero. Threads:
/// the executor's; the same bits for any number. Memory: A V.
class CoarseColumns {
 public:
  /// `offsets`: first scalar of each block row of A, and the total.
  CoarseColumns(const std::vector<int>& offsets, CoarseShape shape, const Executor& executor);

  const CoarseShape& shape() const { return shape_; }
  int num_rows() const { return static_cast<int>(offsets_.size()) - 1; }
  int block_size(int row) const { return offsets_[row + 1] - offsets_[row]; }
  /// First column of each aggregate, and their number.
  const std::vector<int>& column_offsets() const { return column_offsets_; }
  /// From row to row of a block of an aggregate.
  int stride(int aggregate) const;
  double* V(int row) { return V_.data() + V_begin_[row]; }
  const double* V(int row) const { return V_.data() + V_begin_[row]; }
  /// The block at a place of shape().coupled.
  double* AV(int place) { return A_V_.data() + A_V_begin_[place]; }
  const double* AV(int place) const { return A_V_.data() + A_V_begin_[place]; }
  /// Where the block of a row is in the columns of an aggregate; −1: nowhere.
  int PlaceOf(int row, int aggregate) const;

  /// Makes the columns of each aggregate orthonormal in the norm of N = blockdiag(blocks), one
  /// square block a row; a column that the ones before it hold is set to zero.
  void Orthonormalize(const std::vector<const double*>& blocks);

  /// Blocks of the lower half of VᵀA V that rows here add to, and all on its diagonal.
  BlockPattern GalerkinPattern() const;
  /// VᵀA V in a pattern that has all blocks of GalerkinPattern().
  void FormGalerkin(const BlockPattern& pattern, double* values) const;

  /// x = Vᵀ r.
  void Restrict(const double* r, double* x) const;
  /// x = (A V)ᵀ z.
  void RestrictProducts(const double* z, double* x) const;
  /// y = r − A V q.
  void SubtractProducts(const double* q, const double* r, double* y) const;
  /// z += V q.
  void Prolong(const double* q, double* z) const;

  std::int64_t Bytes() const;

 private:
  // a block of A V, seen from its row
  struct RowPlace {
    int aggregate;
    int place;
  };
  void PlaceValues();
  void PlaceProducts();
  void OrthonormalizeAggregate(int aggregate, const std::vector<const double*>& blocks);
  double Product(int aggregate, int a, int b, const std::vector<const double*>& blocks) const;
  void FormColumn(int aggregate, const BlockPattern& pattern, double* values) const;

  const Executor& executor_;
  const CoarseShape shape_;
  std::vector<int> offsets_;
  std::vector<int> column_offsets_;
  std::vector<int> padded_;
  std::vector<int> members_begin_;  // per aggregate, one more
  std::vector<int> members_;        // block rows, ascending
  std::vector<int> rows_begin_;     // per block row, one more
  std::vector<RowPlace> rows_;      // by ascending aggregate
  std::vector<std::int64_t> V_begin_;
  std::vector<std::int64_t> A_V_begin_;
  ZeroedArray V_;
  ZeroedArray A_V_;
};

}  // namespace inceres::internal
