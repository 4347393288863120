#pragma once

#include <cstddef>
#include <vector>

#include "base/aligned_vector.h"
#include "linear/block_rows.h"
#include "linear/row_order.h"
#include "simd/kernels.h"

namespace inceres::internal {

/// L Lᵀ = S + diag(damping), row by row inside the envelope (a row is stored from its first nonzero
/// column on), made to be resumed: with the rows of S in some order, row i of L depends on rows ≤ i
/// of S alone. New frames ordered last leave every earlier row exact, and a change of S from block
/// row i on costs only rows ≥ i. A frame that closes a loop has a long row; its neighbors keep
/// their short ones. Rows and vectors are numbered and packed in that order throughout: row i is
/// the one at place i.
///
/// Resumed or from scratch, a row is computed by the same operations in the same order: the bits
/// are the same. Cost of row i: its length times the lengths of the rows it spans. Threads: the
/// calling one. Source: George & Liu, "Computer Solution of Large Sparse Positive Definite
/// Systems", 1981, chapter 4 (the envelope method).
class EnvelopeCholesky {
 public:
  EnvelopeCholesky() = default;
  EnvelopeCholesky(const EnvelopeCholesky&) = delete;  // its rows point to its memory
  EnvelopeCholesky& operator=(const EnvelopeCholesky&) = delete;

  /// Brings L up to date with S in this order (rows of S that have no place are left out), whose
  /// rows < first_changed are as they were at the last call, in the same places, with the same
  /// damping and mask. `damping` has one entry a scalar row, ≥ 0; those of the rows before
  /// first_changed are not looked at. held[r] != 0 makes row r of S a row of the identity, coupled
  /// to nothing; null: no row is held. False if a pivot is not positive and finite: that of the row
  /// at place num_valid_rows(); rows before it are exact.
  bool Factorize(const SymmetricBlockRows& S, const RowOrder& order, const double* damping,
                 int first_changed, const char* held = nullptr);

  /// Room for so many block rows of so many entries each and `size` scalars: no Factorize within it
  /// allocates.
  void Reserve(int num_rows, int row_entries, int size);

  /// x = (S + diag(damping))⁻¹ b, packed; 0 in held rows.
  void Solve(const double* b, double* x) const;

  /// y = L⁻¹ b from block row first_row on; before it y is right already.
  void ForwardSubstitute(const double* b, int first_row, double* y) const;

  /// One block row of x = L⁻ᵀ y: `rest` is y less what the rows after i contribute. Writes x_i into
  /// `x` and takes its contribution out of `rest` for the rows before i. x and rest may be the same
  /// vector.
  void BackSubstituteRow(int i, double* rest, double* x) const;

  int num_rows() const { return num_rows_; }
  int num_valid_rows() const { return num_valid_rows_; }
  /// The first block row that block row i of L is coupled to; i itself if there is none.
  int FirstColumn(int i) const { return rows_[i].first_column; }
  /// First scalar row of each block row, one more: the total.
  const std::vector<int>& offsets() const { return offsets_; }
  /// Memory held.
  std::size_t Bytes() const {
    return rows_.capacity() * sizeof(EnvelopeRow) + memory_.capacity() * sizeof(RowMemory) +
           offsets_.capacity() * sizeof(int) + list_bytes_;
  }

 private:
  // What a row points to.
  struct RowMemory {
    AlignedVector<double> values;
    std::vector<double> inverse_pivots;
  };

  void CopyRow(const SymmetricBlockRows& S, const RowOrder& order, const double* damping,
               const char* held, int i);
  void CopyBlocks(const SymmetricBlockRows& S, const RowOrder& order, const char* held, int i);
  void MakeRows(int num_rows);
  bool FactorRow(int i);
  void SolveBlock(int i, int j);
  int BlockSize(int i) const { return offsets_[i + 1] - offsets_[i]; }

  std::vector<EnvelopeRow> rows_;
  std::vector<RowMemory> memory_;  // of rows from num_rows_ on it is kept
  int num_rows_ = 0;
  std::vector<int> offsets_{0};
  int num_valid_rows_ = 0;
  std::size_t list_bytes_ = 0;  // of what the rows hold
};

}  // namespace inceres::internal
