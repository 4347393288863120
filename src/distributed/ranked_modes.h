#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "distributed/communicator.h"
#include "distributed/rank_sums.h"
#include "distributed/shared_frames.h"
#include "linear/coarse_columns.h"
#include "linearize/hessian.h"
#include "schur/gauge_modes.h"
#include "schur/mode_columns.h"

namespace inceres::internal {

/// V of a two-level preconditioner for the frames of all ranks, by their numbers, the same on all
/// ranks: how each aggregate moves as a whole. Normal equations of the modes, and the norm that
/// makes them orthonormal, are summed over the ranks; each solves them for itself. Memory: some
/// 1,500 bytes a frame of nine parameters, of all ranks. Calls are collective.
class RankedModes {
 public:
  /// `all`, `here`: aggregates of all frames, and of those here. Fails, on all ranks, as the
  /// analysis of the normal equations.
  RankedModes(const Communicator& ranks, const SharedFrames& frames, const SegmentSums& by_frame,
              const Evaluator& evaluator, const Hessian& hessian, const FramePlans& plans,
              const FrameAggregates& all, const FrameAggregates& here, Status* status);

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

  const Communicator& ranks_;
  const SharedFrames& frames_;
  const SegmentSums& by_frame_;
  const Hessian& hessian_;
  const FramePlans& plans_;
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

}  // namespace inceres::internal
