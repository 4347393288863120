#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "distributed/communicator.h"
#include "distributed/fine_blocks.h"
#include "distributed/rank_sums.h"
#include "distributed/ranked_aggregates.h"
#include "distributed/ranked_modes.h"
#include "distributed/ranked_products.h"
#include "distributed/shared_frames.h"
#include "linear/coarse_space.h"

namespace inceres::internal {

/// The two-level preconditioner (TwoLevelPreconditioner) for frames on several ranks: M⁻¹ = (I − Q
/// A) D⁻¹ (I − A Q) + Q with Q = V (VᵀA V)⁻¹ Vᵀ. V and A V lie with the owners of
/// frames; VᵀA V, which is small, is summed over the ranks and factored by each. Applying it takes
/// two sums of a number a column, of the columns that each rank has a part of, and no product.
///
/// Aggregates stay for good, V until Refresh, VᵀA V until the damping changes. The same bits on
/// all ranks. Calls are collective.
class RankedTwoLevel {
 public:
  /// `elimination`: has all of Y, without a tail, and the blocks of S that the aggregates keep by
  /// owner. Fails, on all ranks, as the analyses of the matrices to be factored.
  static std::unique_ptr<RankedTwoLevel> Make(const Communicator& ranks, const SharedFrames& frames,
                                              const Evaluator& evaluator,
                                              const LandmarkIncidences& incidences,
                                              const FramePlans& plans, const Hessian& hessian,
                                              const Elimination& elimination,
                                              const RankedAggregates& aggregates, Status* status);

  /// The Jacobians are new.
  void Refresh() { modes_are_stale_ = true; }
  /// By the last elimination.
  Status Prepare(const std::vector<double>& owned_damping);
  /// z = M⁻¹ r, of the frames owned here, padded: each starts on a quad.
  void Apply(const double* r, double* z);
  std::int64_t Bytes() const;

 private:
  RankedTwoLevel(const Communicator& ranks, const SharedFrames& frames, const Evaluator& evaluator,
                 const LandmarkIncidences& incidences, const FramePlans& plans,
                 const Hessian& hessian, const Elimination& elimination,
                 const RankedAggregates& aggregates, Status* modes_status, Status* factor_status);
  std::vector<BlockSums::Place> PlacesOfOwned() const;
  std::vector<int> AggregatesOfOwned() const;
  std::vector<int> AggregatesReached() const;

  const Communicator& ranks_;
  const Elimination& elimination_;
  RankedModes modes_;
  RankedProducts products_;
  BlockSums galerkin_;
  SegmentSums restricted_sums_;
  SegmentSums product_sums_;
  CoarseFactor factor_;
  std::unique_ptr<FineBlocks> fine_;
  std::vector<std::int64_t> column_begin_;  // per aggregate, one more
  std::vector<double> restricted_;
  std::vector<double> q_;
  std::vector<double> correction_;
  std::vector<double> deflated_;
  bool modes_are_stale_ = true;
};

}  // namespace inceres::internal
