#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <new>
#include <vector>

#include "base/aligned_vector.h"
#include "incremental/incremental_structure.h"
#include "incremental/index_set.h"
#include "incremental/landmark_blocks.h"
#include "incremental/padded_vectors.h"
#include "incremental/row_changes.h"
#include "linear/block_rows.h"
#include "linearize/incremental_family.h"
#include "simd/kernels.h"

namespace inceres::internal {

/// S, b and diag(C) of an incremental problem, and what has changed of them: sums of what factors
/// contribute, J_cᵀJ_c and −J_cᵀq, and landmarks, −Y Yᵀ and −Y z. A contribution has rows A_r, one
/// for each of its frames, with entries A_r A_cᵀ of S and A_rᵀ v of b; where it takes the place of
/// another, both go through S in one pass.
class SchurSums {
 public:
  /// All of them outlive this.
  SchurSums(std::vector<IncrementalFamily>* families, const IncrementalStructure* structure,
            LandmarkBlocks* blocks)
      : families_(*families), structure_(*structure), blocks_(*blocks) {}

  SymmetricBlockRows& S() { return S_; }
  const SymmetricBlockRows& S() const { return S_; }
  PaddedVectors& vectors() { return vectors_; }
  const PaddedVectors& vectors() const { return vectors_; }
  RowChanges& changes() { return changes_; }

  /// Quad offset of a block of S, which is added if it is not there; row ≥ column. S beyond 64 GiB
  /// has none, and is as good as no memory.
  std::int32_t BlockOf(std::int32_t row, std::int32_t column) {
    const std::ptrdiff_t quad = S_.FindOrAdd(row, column) / kQuad;
    if (quad > std::numeric_limits<std::int32_t>::max()) {
      throw std::bad_alloc();
    }
    return static_cast<std::int32_t>(quad);
  }
  /// The row, its column, and its entries of b and diag(C), before they are summed anew.
  void ZeroRow(std::int32_t row, std::int32_t quad, int size) {
    S_.ZeroRow(row);
    vectors_.Zero(quad, size);
  }

  /// The factor's blocks of S are looked up anew: it has come to these frames.
  void ConnectFactor(FactorRef ref);
  /// It leaves them; its contribution is not in S any more.
  void DisconnectFactor(FactorRef ref);
  /// With the Jacobians cached now: sign +1 adds, -1 takes out.
  void AddFactor(FactorRef ref, double sign);
  /// The same where the rows are known to have changed; false: it has no place in S.
  bool SumFactor(FactorRef ref, double sign);
  /// The same of its part in one row of S, and that row's column.
  void AddFactorToRow(FactorRef ref, std::int32_t only);
  /// Jacobians are about to change: KeepFactor before, ReplaceFactor after, with what it gave.
  /// DropKept ends the lot.
  std::ptrdiff_t KeepFactor(FactorRef ref);
  void ReplaceFactor(FactorRef ref, std::ptrdiff_t kept);
  void DropKept() { num_kept_ = 0; }

  /// With the Y and z that the landmark has: sign -1 puts it in, +1 takes it out.
  void AddLandmark(std::int32_t landmark, double sign);
  /// The same of the blocks and entries between these rows alone.
  void AddLandmarkWithin(std::int32_t landmark, double sign, const IndexSet& rows);
  /// The same of one row, and its column; all rows are marked as changed.
  void AddLandmarkAcross(std::int32_t landmark, double sign, std::int32_t row);
  /// Y and z anew from this η, in place of those that are in S.
  void EliminateAnew(std::int32_t landmark, const double* eta);

  std::int64_t Bytes() const {
    std::size_t bytes = vectors_.Bytes() + sizeof(double) * (kept_.capacity() + Y_out_.capacity());
    for (const std::vector<std::int32_t>& blocks : factor_blocks_) {
      bytes += blocks.capacity() * sizeof(std::int32_t);
    }
    return S_.Bytes() + static_cast<std::int64_t>(bytes);
  }

 private:
  // S gains, or with the sign -1 loses, A_r A_cᵀ at blocks[…], row by row of the lower triangle;
  // -1: not this one.
  void AddProducts(const Contribution& contribution, double sign, const std::int32_t* blocks) {
    kernels_.add_outer(contribution, sign, blocks, S_.values(0));
  }
  // b gains A_rᵀ v, in place of what it had by v_out unless that is null.
  void AddToB(const Contribution& contribution, const double* v, const double* v_out, double sign) {
    kernels_.add_transposed(contribution, v, v_out, sign, vectors_.rhs(), vectors_.b_peak());
  }
  // diag(C) gains the squares of A's columns.
  void AddSquares(const Contribution& contribution, double sign) {
    kernels_.add_squares(contribution, sign, vectors_.diagonal(), vectors_.diagonal_peak());
  }
  // All three of a factor with the residual q, in place of q_out unless that is null: b has −Jᵀq.
  void AddContribution(const Contribution& contribution, const double* q, const double* q_out,
                       double sign, const std::int32_t* blocks) {
    kernels_.add_contribution(contribution, sign,
                              {blocks, S_.values(0), q, q_out, vectors_.rhs(), vectors_.b_peak(),
                               vectors_.diagonal(), vectors_.diagonal_peak()});
  }
  void Touch(const std::vector<std::int32_t>& rows) {
    for (const std::int32_t row : rows) {
      changes_.Touch(row);
    }
  }

  Contribution RowsOf(FactorRef ref);
  std::int32_t* FactorBlocks(FactorRef ref) {
    const int num_slots = families_[ref.family].num_slots();
    return factor_blocks_[ref.family].data() +
           std::ptrdiff_t{ref.factor} * (num_slots * (num_slots + 1) / 2);
  }
  bool HasBlocks(FactorRef ref) { return FactorBlocks(ref)[0] >= 0; }
  const std::int32_t* BlocksOf(FactorRef ref);
  void ReleaseBlocks(FactorRef ref);
  bool IsCoupled(std::int32_t row, std::int32_t column);
  bool IsTurnedOff(FactorRef ref) const;
  double* KeepRoom(std::ptrdiff_t count);

  template <typename Part>
  void AddPart(std::int32_t landmark, double sign, const Part& part);
  const std::vector<std::int32_t>& FramesOf(std::int32_t landmark) const {
    return structure_.landmarks()[landmark].frames;
  }

  std::vector<IncrementalFamily>& families_;
  const IncrementalStructure& structure_;
  LandmarkBlocks& blocks_;
  const Kernels& kernels_ = BestKernels();
  SymmetricBlockRows S_;
  PaddedVectors vectors_;
  RowChanges changes_;
  // Per family, factor and pair of its frames, ascending: quad offset of the block of S; the first
  // -1: the factor has none, for it has just come or is turned off.
  std::vector<std::vector<std::int32_t>> factor_blocks_;
  // Of the factor's contribution under way.
  std::vector<BlockRow> factor_rows_;  // and room for more
  std::vector<std::int32_t> factor_frames_;
  std::vector<std::int32_t> factor_targets_;  // of some rows alone
  AlignedVector<double> kept_;                // rows and q of factors, as they are in S
  std::ptrdiff_t num_kept_ = 0;               // entries of it in use
  // Of the landmark's contribution under way.
  std::vector<BlockRow> landmark_rows_;         // and room for more
  std::vector<std::int32_t> landmark_targets_;  // of some rows alone
  AlignedVector<double> Y_out_;                 // as it is in S
};

}  // namespace inceres::internal
