#pragma once

#include <cstdint>
#include <vector>

#include "base/aligned_vector.h"
#include "incremental/index_set.h"
#include "incremental/landmark_blocks.h"
#include "incremental/schur_sums.h"
#include "simd/kernels.h"

namespace inceres::internal {

/// The contributions of landmarks to S and b, −Y Yᵀ and −Y z: added, taken out, and replaced when
/// the landmark is eliminated anew.
class LandmarkContributions {
 public:
  /// All of them outlive this.
  LandmarkContributions(const IncrementalStructure* structure, LandmarkBlocks* blocks,
                        SchurSums* sums)
      : structure_(*structure), blocks_(*blocks), sums_(*sums) {}

  /// With the Y and z it has: sign -1 puts it in, +1 takes it out.
  void Add(std::int32_t landmark, double sign);
  /// The same of the blocks and entries between these rows alone.
  void AddWithin(std::int32_t landmark, double sign, const IndexSet& rows);
  /// The same of one row, and its column; all rows are marked as changed.
  void AddAcross(std::int32_t landmark, double sign, std::int32_t row);
  /// Y and z anew from this η, in place of those that are in S.
  void EliminateAnew(std::int32_t landmark, const double* eta);

  std::size_t Bytes() const { return sizeof(double) * Y_out_.capacity(); }

 private:
  template <typename Part>
  void AddPart(std::int32_t landmark, double sign, const Part& part);
  const std::vector<std::int32_t>& FramesOf(std::int32_t landmark) const {
    return structure_.landmarks()[landmark].frames;
  }

  const IncrementalStructure& structure_;
  LandmarkBlocks& blocks_;
  SchurSums& sums_;
  std::vector<BlockRow> rows_;         // of the contribution under way, and room for more
  std::vector<std::int32_t> targets_;  // of some rows alone
  AlignedVector<double> Y_out_;        // as it is in S
};

}  // namespace inceres::internal
