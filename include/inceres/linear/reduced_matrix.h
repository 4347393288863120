#pragma once

#include <cstdint>
#include <vector>

#include "inceres/export.h"

namespace inceres {

namespace internal {
class SymmetricBlockRows;
}

/// Where the blocks of the symmetric reduced matrix S are: the lower triangle, block rows in order,
/// columns ascending within a row, the diagonal block always present and last in its row. Block k,
/// at (i, j), is d_i × d_j and row-major; its values begin at value_begin[k], row_stride(j) from
/// row to row; of a diagonal block the whole square is stored.
struct BlockPattern {
  /// first scalar row of each block row; one more entry than blocks: the total size
  std::vector<int> offsets;
  std::vector<int> row_begin;  ///< blocks of row i are [row_begin[i], row_begin[i + 1])
  std::vector<int> columns;    ///< block column of each block
  /// Offset of each block's values; one more entry: the total count. In a batch solve blocks follow
  /// each other without a gap.
  std::vector<std::int64_t> value_begin;
  bool padded = false;  ///< rows of a block are padded to whole fours
  /// Per block row: of two that the factor couples, that of the lower group is to be eliminated
  /// first (FactorGraph::SetEliminationGroup). Empty: as the solver likes.
  std::vector<int> groups;

  /// Block rows, as many as frames.
  int num_blocks() const { return static_cast<int>(offsets.size()) - 1; }
  /// Scalar rows.
  int size() const { return offsets.back(); }
  /// Scalar rows of a block row.
  int block_size(int i) const {
    return offsets[static_cast<std::size_t>(i) + 1] - offsets[static_cast<std::size_t>(i)];
  }
  /// From row to row of a block in this column.
  int row_stride(int column) const {
    return padded ? (block_size(column) + 3) / 4 * 4 : block_size(column);
  }
};

/// The symmetric positive definite A = S + diag(diagonal) of the reduced system, as solvers see it,
/// in both modes: a view of what others own. A variable of an incremental solve that is constant
/// for now keeps its rows in the pattern, so that to hold and free it costs no symbolic analysis;
/// but its blocks are left out, its diagonal is 1, and its entries of b are 0.
class INCERES_EXPORT ReducedMatrix {
 public:
  /// Of a batch solve.
  ReducedMatrix(const BlockPattern& pattern, const double* values, const double* diagonal)
      : pattern_(&pattern), values_(values), diagonal_(diagonal) {}
  /// Of an incremental one, in which rows come and go. constant[r] != 0: row r is held; null: none
  /// is.
  ReducedMatrix(const internal::SymmetricBlockRows& rows, const double* diagonal,
                const char* constant)
      : diagonal_(diagonal), rows_(&rows), constant_(constant) {}

  /// Of S. Stays alive, and as it is, until the next ReducedSolver::Analyze.
  const BlockPattern& pattern() const { return pattern_ != nullptr ? *pattern_ : GrownPattern(); }

  /// Calls visit(i, j, block, stride) for the blocks (i, j) of S that are not left out, by rows:
  /// d_i × d_j and row-major, `stride` from row to row. Of a diagonal block the lower triangle
  /// counts.
  template <typename Visit>
  void ForEachBlock(const Visit& visit) const {
    const BlockPattern& blocks = pattern();
    for (int i = 0; i < blocks.num_blocks(); ++i) {
      for (int k = blocks.row_begin[i]; k < blocks.row_begin[i + 1]; ++k) {
        if (const double* block = Block(i, k)) {
          visit(i, blocks.columns[k], block, blocks.row_stride(blocks.columns[k]));
        }
      }
    }
  }
  /// Block k of the pattern, which is in row i; null where it is left out.
  const double* Block(int i, int k) const {
    return rows_ == nullptr ? values_ + pattern_->value_begin[static_cast<std::size_t>(k)]
                            : GrownBlock(i, k);
  }

  /// pattern().size() entries ≥ 0.
  const double* diagonal() const { return diagonal_; }

  /// What row i of the pattern is called in ReducedSolver::Rows, for good: ascending, and i itself
  /// in a batch solve.
  int RowId(int i) const;

  /// The same of an incremental solve by rows that stay where they are, for solvers of our own that
  /// resume; null in a batch solve.
  const internal::SymmetricBlockRows* rows() const { return rows_; }
  const char* constant() const { return constant_; }  ///< per row of these; null: none is

 private:
  const BlockPattern& GrownPattern() const;
  const double* GrownBlock(int i, int k) const;

  const BlockPattern* pattern_ = nullptr;
  const double* values_ = nullptr;
  const double* diagonal_;
  const internal::SymmetricBlockRows* rows_ = nullptr;
  const char* constant_ = nullptr;
};

}  // namespace inceres
