#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "distributed/block_shares.h"
#include "distributed/communicator.h"
#include "distributed/rank_sums.h"
#include "distributed/ranked_aggregates.h"
#include "distributed/reduced_system.h"
#include "linear/cluster_cholesky.h"
#include "linear/coarse_columns.h"
#include "linear/coarse_space.h"
#include "schur/frame_aggregates.h"
#include "schur/gauge_modes.h"
#include "schur/projected_products.h"

namespace inceres::internal {

/// V of a two-level preconditioner for the frames of all ranks, by their numbers, the same on all
/// ranks: how each aggregate moves as a whole. Normal equations of the modes, and the norm that
/// makes them orthonormal, are summed over the ranks; each solves them for itself. Memory: some
/// 1,500 bytes a frame of nine parameters, of all ranks. Calls are collective.
class RankedModes {
 public:
  /// Fails, on all ranks, as the analysis of the normal equations.
  RankedModes(const RankedParts& parts, const RankedAggregates& aggregates, Status* status);

  /// Columns of each aggregate.
  const std::vector<int>& widths() const { return columns_->widths(); }
  /// Where the evaluator's Jacobians are.
  void Compute();
  /// Of the last Compute: the block of a frame, with the rows of CoarseColumns.
  const double* V(int number) const { return V_->V(number); }
  std::int64_t Bytes() const;

 private:
  std::vector<BlockSums::Place> PlacesHere() const;
  GaugeOrigin AgreeOnOrigin() const;
  void SumNormals();
  std::vector<const double*> SumNorm();

  const RankedParts& parts_;
  const SegmentSums& by_frame_;
  GaugeNormals normals_;
  BlockSums C_sums_;
  GaugeSums here_;
  GaugeSums all_;
  GaugeFit fit_;
  bool by_gauge_ = false;
  std::unique_ptr<ModeColumns> columns_;
  std::unique_ptr<CoarseColumns> V_;
  std::vector<double> norm_;  // blocks of C on the diagonal, of all frames
};

/// V and A V of the frames owned here. A V is a sum over the factors and landmarks of all ranks:
/// each forms its part, for one batch of aggregates after the other, and sends the rows of frames
/// that it does not own to their owners. Sums are the owner's part first, then those of the others
/// in the order of the ranks. Calls are collective. Memory: A V of the owned frames, and the part
/// of a batch.
class RankedProducts {
 public:
  /// `here`: aggregates of the frames here. `widths`: columns of each aggregate.
  RankedProducts(const RankedParts& parts, const FrameAggregates& here,
                 const std::vector<int>& widths);

  /// By the last elimination, with Λ_c = diag(owned_damping), packed.
  void Form(const RankedModes& modes, const std::vector<double>& owned_damping);
  /// Rows: the frames owned here, in the order of their numbers.
  const CoarseColumns& owned() const { return *owned_; }
  std::int64_t Bytes() const;

 private:
  struct Key;  // a block of A V
  // Some of the aggregates.
  struct Batch {
    AggregateReach reach;  // of the frames here
    // Places in the batch's columns, of the rows owned here and of those of each rank, and places
    // in the owned columns: where the own ones go, and what comes from others.
    std::vector<int> own_from;
    std::vector<int> own_to;
    std::vector<std::vector<int>> sent;
    std::vector<int> received_to;
  };
  std::vector<Key> ExchangeKeys(const CoarseShape& shape) const;
  CoarseShape ShapeOfOwned(const CoarseShape& here) const;
  int PlaceOf(const Key& key) const;
  void CutIntoBatches(const AggregateReach& reach);
  void Plan(Batch* batch) const;
  void FormBatch(const Batch& batch, const RankedModes& modes);
  void Add(const double* block, int place);
  void AddDamping(const std::vector<double>& owned_damping);

  const RankedParts& parts_;
  const std::vector<int>& offsets_;  // of the frames here
  const ProjectedProducts products_;
  std::unique_ptr<CoarseColumns> owned_;
  std::vector<int> block_sizes_;  // per place of the owned columns: entries
  std::vector<Batch> batches_;
  std::vector<double> no_damping_;
};

/// The two-level preconditioner (TwoLevelPreconditioner) for frames on several ranks: M⁻¹ = (I − Q
/// A) D⁻¹ (I − A Q) + Q with Q = V (VᵀA V)⁻¹ Vᵀ. V and A V lie with the owners of
/// frames; VᵀA V, which is small, is summed over the ranks and factored by each. Applying it takes
/// two sums of a number a column, of the columns that each rank has a part of, and no product.
///
/// Aggregates stay for good, V until Refresh, VᵀA V until the damping changes. The same bits on
/// all ranks. Calls are collective.
class RankedTwoLevel {
 public:
  /// The elimination of `parts` has all of Y, without a tail, and the blocks of S that the
  /// aggregates keep by owner. Fails, on all ranks, as the analyses of the matrices to be factored.
  RankedTwoLevel(const RankedParts& parts, const RankedAggregates& aggregates, Status* status);

  /// The Jacobians are new.
  void Refresh() { modes_are_stale_ = true; }
  /// By the last elimination.
  Status Prepare(const std::vector<double>& owned_damping);
  /// z = M⁻¹ r, of the frames owned here, padded: each starts on a quad.
  void Apply(const double* r, double* z);
  std::int64_t Bytes() const;

 private:
  BlockPattern FinePattern() const;
  std::vector<BlockSums::Place> PlacesOfOwned() const;
  std::vector<int> AggregatesOfOwned() const;
  std::vector<int> AggregatesReached() const;

  const RankedParts& parts_;
  RankedModes modes_;
  RankedProducts products_;
  BlockSums galerkin_;
  SegmentSums restricted_sums_;
  SegmentSums product_sums_;
  std::unique_ptr<CoarseFactor> factor_;
  BlockShares fine_shares_;
  std::unique_ptr<ClusterCholesky> fine_;   // D
  std::vector<std::int64_t> column_begin_;  // per aggregate, one more
  std::vector<double> restricted_;
  std::vector<double> q_;
  std::vector<double> correction_;
  std::vector<double> deflated_;
  bool modes_are_stale_ = true;
};

}  // namespace inceres::internal
