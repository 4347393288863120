#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <new>
#include <vector>

#include "incremental/padded_vectors.h"
#include "incremental/row_changes.h"
#include "linear/block_rows.h"
#include "simd/kernels.h"
#include "simd/small_kernels.h"

namespace inceres::internal {

/// S, b and diag(C) of an incremental problem, and what has changed of them: sums of what factors
/// and landmarks contribute. A contribution has rows A_r, one for each of its frames, with entries
/// A_r A_cᵀ of S and A_rᵀ v of b; where it takes the place of another, both go through S in one
/// pass.
class SchurSums {
 public:
  SymmetricBlockRows& S() { return S_; }
  const SymmetricBlockRows& S() const { return S_; }
  PaddedVectors& vectors() { return vectors_; }
  const PaddedVectors& vectors() const { return vectors_; }
  RowChanges& changes() { return changes_; }
  const RowChanges& changes() const { return changes_; }

  /// Quad offset of a block of S, which is added if it is not there; row ≥ column. S beyond 64 GiB
  /// has none, and is as good as no memory.
  std::int32_t BlockOf(std::int32_t row, std::int32_t column) {
    const std::ptrdiff_t quad = S_.FindOrAdd(row, column) / kQuad;
    if (quad > std::numeric_limits<std::int32_t>::max()) {
      throw std::bad_alloc();
    }
    return static_cast<std::int32_t>(quad);
  }

  /// S gains, or with the sign -1 loses, A_r A_cᵀ at blocks[…], row by row of the lower triangle;
  /// -1: not this one.
  void AddProducts(const Contribution& contribution, double sign, const std::int32_t* blocks) {
    kernels_.add_outer(contribution, sign, blocks, S_.values(0));
  }
  /// b gains A_rᵀ v, in place of what it had by v_out unless that is null.
  void AddToB(const Contribution& contribution, const double* v, const double* v_out, double sign) {
    kernels_.add_transposed(contribution, v, v_out, sign, vectors_.rhs(), vectors_.b_peak());
  }
  /// diag(C) gains the squares of A's columns.
  void AddSquares(const Contribution& contribution, double sign) {
    kernels_.add_squares(contribution, sign, vectors_.diagonal(), vectors_.diagonal_peak());
  }
  /// All three of a factor with the residual q, in place of q_out unless that is null: b has −Jᵀq.
  void AddFactor(const Contribution& contribution, const double* q, const double* q_out,
                 double sign, const std::int32_t* blocks) {
    small_kernels_.add_contribution(
        contribution, sign,
        {blocks, S_.values(0), q, q_out, vectors_.rhs(), vectors_.b_peak(), vectors_.diagonal(),
         vectors_.diagonal_peak()});
  }
  void Touch(const std::vector<std::int32_t>& rows) {
    for (const std::int32_t row : rows) {
      changes_.Touch(row);
    }
  }
  /// The row, its column, and its entries of b and diag(C), before they are summed anew.
  void ZeroRow(std::int32_t row, std::int32_t quad, int size) {
    S_.ZeroRow(row);
    vectors_.Zero(quad, size);
  }

  std::int64_t Bytes() const { return S_.Bytes() + static_cast<std::int64_t>(vectors_.Bytes()); }

 private:
  const Kernels& kernels_ = BestKernels();
  const SmallKernels& small_kernels_ = BestSmallKernels();
  SymmetricBlockRows S_;
  PaddedVectors vectors_;
  RowChanges changes_;
};

}  // namespace inceres::internal
