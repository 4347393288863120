#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/aligned_vector.h"
#include "incremental/incremental_structure.h"
#include "incremental/schur_sums.h"
#include "linearize/incremental_family.h"
#include "simd/kernels.h"

namespace inceres::internal {

/// The frame parts of factors in S and b, J_cᵀJ_c and −J_cᵀq: added, taken out, and replaced when
/// their Jacobians change.
class FactorContributions {
 public:
  /// All of them outlive this.
  FactorContributions(std::vector<IncrementalFamily>* families,
                      const IncrementalStructure* structure, SchurSums* sums)
      : families_(*families), structure_(*structure), sums_(*sums) {}

  /// The factor's blocks of S are looked up anew: it has come to these frames.
  void Connect(FactorRef ref);
  /// It leaves them; its contribution is not in S any more.
  void Disconnect(FactorRef ref);

  /// With the Jacobians cached now: sign +1 adds, -1 takes out.
  void Add(FactorRef ref, double sign);
  /// The same where the rows are known to have changed; false: it has no place in S.
  bool Sum(FactorRef ref, double sign);
  /// The same of its part in one row of S, and that row's column.
  void AddToRow(FactorRef ref, std::int32_t only);
  /// Jacobians are about to change: Keep before, Replace after, with what it gave. DropKept ends
  /// the lot.
  std::ptrdiff_t Keep(FactorRef ref);
  void Replace(FactorRef ref, std::ptrdiff_t kept);
  void DropKept() { num_kept_ = 0; }

  std::size_t Bytes() const;

 private:
  Contribution RowsOf(FactorRef ref);
  std::int32_t* Blocks(FactorRef ref) {
    const int num_slots = families_[ref.family].num_slots();
    return blocks_[ref.family].data() +
           std::ptrdiff_t{ref.factor} * (num_slots * (num_slots + 1) / 2);
  }
  bool HasBlocks(FactorRef ref) { return Blocks(ref)[0] >= 0; }
  const std::int32_t* BlocksOf(FactorRef ref);
  void ReleaseBlocks(FactorRef ref);
  bool IsCoupled(std::int32_t row, std::int32_t column);
  bool IsTurnedOff(FactorRef ref) const;
  double* KeepRoom(std::ptrdiff_t count);

  std::vector<IncrementalFamily>& families_;
  const IncrementalStructure& structure_;
  SchurSums& sums_;
  // Per family, factor and pair of its frames, ascending: quad offset of the block of S; the first
  // -1: the factor has none, for it has just come or is turned off.
  std::vector<std::vector<std::int32_t>> blocks_;
  std::vector<BlockRow> rows_;         // of the contribution under way, and room for more
  std::vector<std::int32_t> rows_of_;  // their frames
  std::vector<std::int32_t> targets_;  // those of some rows alone
  AlignedVector<double> kept_;         // rows and q, as they are in S
  std::ptrdiff_t num_kept_ = 0;        // entries of it in use
};

}  // namespace inceres::internal
