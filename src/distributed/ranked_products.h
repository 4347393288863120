#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "distributed/communicator.h"
#include "distributed/ranked_modes.h"
#include "distributed/shared_frames.h"
#include "linear/coarse_columns.h"
#include "schur/frame_aggregates.h"
#include "schur/projected_products.h"

namespace inceres::internal {

/// V and A V of the frames owned here. A V is a sum over the factors and landmarks of all ranks:
/// each forms its part, for one batch of aggregates after the other, and sends the rows of frames
/// that it does not own to their owners. Sums are the owner's part first, then those of the others
/// in the order of the ranks. Calls are collective. Memory: A V of the owned frames, and the part
/// of a batch.
class RankedProducts {
 public:
  /// `here`: aggregates of the frames here. `widths`: columns of each aggregate.
  RankedProducts(const Communicator& ranks, const SharedFrames& frames, const Evaluator& evaluator,
                 const LandmarkIncidences& incidences, const FramePlans& plans,
                 const Hessian& hessian, const Elimination& elimination,
                 const FrameAggregates& here, const std::vector<int>& widths);

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

  const Communicator& ranks_;
  const SharedFrames& frames_;
  const Evaluator& evaluator_;
  const std::vector<int>& offsets_;  // of the frames here
  const ProjectedProducts products_;
  std::vector<int> row_of_number_;  // per frame of all ranks: its row; −1: not owned here
  std::unique_ptr<CoarseColumns> owned_;
  std::vector<int> block_sizes_;  // per place of the owned columns: entries
  std::vector<Batch> batches_;
  std::vector<double> no_damping_;
};

}  // namespace inceres::internal
